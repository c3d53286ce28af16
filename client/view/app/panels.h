// The parts of the screen. Each part fills its area. The parts on the left and right have several
// headings; each heading has a file of its own.
//
// Threads: that of the frames, within a frame of Dear ImGui.
#pragma once

#include "client/view/app/layout.h"
#include "client/view/app/viewer.h"

namespace palpate::view {

// Connection, volume, emergency stop: always visible.
void DrawTopBar(Viewer& viewer, const Area& area, float scale);
// Whether forces act, why not, and the button that is allowed: always visible.
void DrawStateBar(Viewer& viewer, const Area& area, float scale);
// The picture, with legend and messages.
void DrawView(Viewer& viewer, const Area& area, float scale);
void DrawLeftPanels(Viewer& viewer, const Area& area, float scale);
void DrawRightPanels(Viewer& viewer, const Area& area, float scale);
void DrawSeriesBar(Viewer& viewer, const Area& area);
void DrawSlices(Viewer& viewer, const Area& area);
void DrawHelp(Viewer& viewer, float scale);
// Opens the dialog for palpated's address and our credentials. It stays until the user closes it.
void OpenConnectDialog(Viewer& viewer);
void DrawConnectDialog(Viewer& viewer, float scale);

// Headings on the left.
void IsovaluePanel(Viewer& viewer, float scale);
void LookPanel(Viewer& viewer);
void CutsPanel(Viewer& viewer);
void BrushPanel(Viewer& viewer);
// Headings on the right.
void DevicePanel(Viewer& viewer);
void PlotsPanel(Viewer& viewer, float scale);
void RecordingPanel(Viewer& viewer);
void FeelPanel(Viewer& viewer);

}  // namespace palpate::view
