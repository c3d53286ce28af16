// What drawings share: OpenGL's state, which a window's toolkit changes, too; its errors; textures.
//
// Threads: that of the current OpenGL 4.3 context.
#pragma once

#include "client/view/drawing/camera.h"

namespace palpate::view {

// Resets to OpenGL's defaults all state that other code may leave changed and that would spoil a
// drawing.
void ResetState();

// Returns true if there have been errors since the last call. Call it first before a request for
// memory, too: older errors must not be taken for errors of the request.
bool TakeErrors();

// Returns the name of a new 2-D texture, which is bound. It is not filtered.
unsigned NewTexture(unsigned format, const ImageSize& size);
// `kind`: such as GL_TEXTURE_2D.
void BindTexture(int unit, unsigned kind, unsigned texture);

}  // namespace palpate::view
