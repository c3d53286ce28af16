// Pictures as PNG files.
//
// Threads: any. Errors: kNotFound (no such folder), kPermissionDenied, kInternal (a full disk).
#pragma once

#include <string>

#include "client/view/render/frame_renderer.h"

namespace palpate::view {

// Writes the complete file, replacing an earlier one, or nothing. Alpha is left out: pictures are
// opaque.
void WritePng(const Image& image, const std::string& path);

// Checks before the work that WritePng could begin a file of this name. Throws its errors.
void RequireWritable(const std::string& path);

// Returns "palpate-20260131-174502.png" with the local time, in the current folder. If the name is
// taken: with "-2" and so on.
std::string NewPictureName();

}  // namespace palpate::view
