// The OpenGL state, which the renderer shares with a window's toolkit.
//
// Threads: that of the current OpenGL 4.3 context.
#pragma once

namespace palpate::view {

// Resets to OpenGL's defaults all state that other code may leave changed and that would spoil a
// drawing.
void ResetState();

}  // namespace palpate::view
