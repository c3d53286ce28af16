// The context's state, which a window's toolkit shares with the renderer.
//
// Threads: that of the current OpenGL 4.3 context.
#pragma once

namespace palpate::view {

// What others may have left behind that would spoil a drawing: back to OpenGL's defaults.
void ResetState();

}  // namespace palpate::view
