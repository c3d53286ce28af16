// Pictures as PNG files.
//
// Threads: any. Errors: Error with kNotFound for a folder that is not there,
// kPermissionDenied, kInternal (a full disk).
#pragma once

#include <string>

#include "client/view/render/frame_renderer.h"

namespace palpate::view {

// The whole file, in place of an earlier one, or none. Alpha is left out: pictures
// are opaque.
void WritePng(const Image& image, const std::string& path);

// That a file of this name can be begun: as WritePng would say, but before the work.
void RequireWritable(const std::string& path);

// "palpate-20260131-174502.png" of local time, in the current folder; with "-2" and so
// on where that is taken.
std::string NewPictureName();

}  // namespace palpate::view
