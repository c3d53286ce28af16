// Pictures as PNG files.
//
// Threads: any. Errors: those of NewFile.
#pragma once

#include <string>

#include "common/files/new_file.h"

#include "client/view/render/frame_renderer.h"

namespace palpate::view {

// Writes the complete file or nothing. Alpha is left out: pictures are opaque.
void WritePng(const Image& image, const std::string& path, IfThere if_there);

// Returns "palpate-20260131-174502.png" with the local time, in the current folder. If the name is
// taken: with "-2" and so on.
std::string NewPictureName();

}  // namespace palpate::view
