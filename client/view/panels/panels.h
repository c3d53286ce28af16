// The parts of the screen. Each part fills its area. The sides have several panels.
//
// Threads: that of the frames, within a frame of Dear ImGui.
#pragma once

#include "client/view/viewer/layout.h"
#include "client/view/viewer/viewer.h"

namespace palpate::view {

// Connection, volume, Record, Undo, Redo, people, emergency stop: always visible.
void DrawTopBar(Viewer& viewer, const Area& area, float scale);
// Whether forces act, why not, and the button that is allowed: visible but on the start page.
void DrawStateBar(Viewer& viewer, const Area& area, float scale);
// The picture, with legend and messages.
void DrawView(Viewer& viewer, const Area& area, const Layout& layout, bool has_legend, float scale);
// What a drag in the view does, and the sides on or off: always visible.
void DrawToolBar(Viewer& viewer, const Layout& layout, float scale);
// Why the user cannot take the tool; empty: they can.
std::string WhyNot(const Viewer& viewer, Tool tool);
// How the pointer leads the hand, at the view's lower edge, while it does. Returns its height.
float DrawHandStrip(Viewer& viewer, const Area& view, float scale);
// The last 10 seconds: the bar is always visible.
void DrawPlots(Viewer& viewer, const Layout& layout, float scale);
// A refusal of the last command, near the last click if that was in a side; else the view shows it.
void DrawRefusal(const Viewer& viewer, const Layout& layout, float scale);
// Over the view while a recording is shown in place of the live state.
void DrawReplayBanner(const Viewer& viewer, const Area& area, float scale);
void DrawSeriesBar(Viewer& viewer, const Area& area);
// A slice that fills the view is in `view`; the view is in that slice's place then.
void DrawSlices(Viewer& viewer, const SliceStrip& strip, const Area& view, float scale);
void DrawHelp(Viewer& viewer, const Layout& layout, float scale);
// Opens the dialog for palpated's address and our credentials. It stays until the user closes it.
void OpenConnectDialog(Viewer& viewer);
void DrawConnectDialog(Viewer& viewer, float scale);
// Reads the profiles again, for the dialog and for the start page.
void ReadProfiles(Viewer& viewer);
// Connects; an error is shown in the dialog and on the start page.
void ConnectTo(Viewer& viewer, const client::ServerChoice& server);

// What a person without a volume can do: start palpated, connect, open.
void DrawStartPage(Viewer& viewer, const Area& area, float scale);
// The button of the menu for files, in the current panel.
void DrawFileMenu(Viewer& viewer);
// What the import assumed or left out: a line above the view, with all of it as a tooltip.
void DrawNotice(Viewer& viewer, const Area& area, float scale);
// Progress, questions and errors of files: within the current window, or over the view.
void ShowFileCard(Viewer& viewer);
void DrawFileCard(Viewer& viewer, const Area& area, float scale);
// The window for typing a path, to open or to save.
void DrawPathForm(Viewer& viewer, float scale);

// The tabs on the left.
void SurfaceTab(Viewer& viewer);
void LookTab(Viewer& viewer);
void CutTab(Viewer& viewer);
void EditTab(Viewer& viewer);
// The headings on the right.
inline constexpr const char* kFeelHeading = "Feel, for everyone";
inline constexpr const char* kToolHeading = "Tool in the hand, for everyone";
inline constexpr const char* kDeviceHeading = "Device";
void FeelPanel(Viewer& viewer);
void ToolPanel(Viewer& viewer);
void DevicePanel(Viewer& viewer);
// Recordings: made here, listed and replayed.
void SessionPanel(Viewer& viewer);
// Keeps the session's state true while its panel is hidden, too. Call it once per frame.
void FollowSession(Viewer& viewer);
bool IsRecording(const Viewer& viewer);
// Why a recording can neither begin nor end here; empty: it can.
std::string WhyNotRecord(const Viewer& viewer);
void ToggleRecording(Viewer& viewer);
// Puts a marker with the panel's text into the recording that runs.
void PutMarker(Viewer& viewer);

}  // namespace palpate::view
