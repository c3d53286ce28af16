// What the importer may reach of files, whatever makes it try: a link that is put in place after it
// was looked at, or a fault of a library that a hostile file sets off. The kernel refuses the rest
// (Landlock, Linux 5.13 and later), and it cannot be taken back.
//
// Before the first thread is started. Errors: Error (kInternal) where the kernel knows Landlock and
// refuses; where it does not, nothing is confined.
#pragma once

#include <filesystem>
#include <vector>

namespace palpate {

// Leaves: to read, these folders with all below them, and the system's libraries; to write, files
// in `output_folder`. Those that are not there, or whose path has come to hold a link, are left
// out.
void Confine(const std::vector<std::filesystem::path>& readable,
             const std::filesystem::path& output_folder);

}  // namespace palpate
