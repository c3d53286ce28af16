// The parts of the screen. Each fills its area; those on the left and on the right have
// several headings, each in a file of its name.
//
// Threads: that of the frames, within one of Dear ImGui's.
#pragma once

#include "client/view/app/layout.h"
#include "client/view/app/viewer.h"

namespace palpate::view {

// Connection, volume, emergency stop: always there.
void DrawTopBar(Viewer& viewer, const Area& area, float scale);
// The picture, with legend and messages.
void DrawView(Viewer& viewer, const Area& area, float scale);
void DrawLeftPanels(Viewer& viewer, const Area& area, float scale);
void DrawRightPanels(Viewer& viewer, const Area& area, float scale);
void DrawSeriesBar(Viewer& viewer, const Area& area);
void DrawSlices(Viewer& viewer, const Area& area);
void DrawHelp(Viewer& viewer, float scale);
// Where palpated is and who we are there; shown until it is closed.
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
