// Receives a volume from a client and stores it as a file for the importer.
//
// The importer needs a named file, because the suffix tells the format. The file lies in a folder
// that only this user can enter. The destructor removes the file and the folder, also after a
// failure. If the daemon is killed, the next start removes its files (RemoveAbandonedUploads).
//
// Threads: one at a time. Errors: Error; destroy the object after an error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "server/kept/private_folder.h"
#include "server/live_volume/memory_budget.h"

namespace palpate {

struct UploadOptions {
  std::filesystem::path folder = TemporaryFolder();  // may be a file system in memory
  std::uint64_t max_bytes = std::uint64_t{4} << 30;
  bool vdb = true;  // accept .vdb files
};

struct UploadFile {
  std::string name;  // without a folder
  std::uint64_t size_bytes = 0;
};

// The client's announcement.
struct UploadStart {
  std::string name;  // file name without a folder, with its suffix
  std::uint64_t size_bytes = 0;
  std::uint32_t crc32 = 0;    // of all bytes, as zlib computes it
  bool holds_voxels = false;  // raw voxels without a header: any suffix is accepted
  // For a folder of this name: its files, in the order of the bytes.
  std::vector<UploadFile> files{};
};

class Upload {
 public:
  static constexpr char kMaxKey[] = "volume.max_upload_mib";
  static constexpr char kVdbKey[] = "volume.upload_vdb";

  // Claims memory for the upload and makes the file. Throws Error:
  //   kInvalidArgument    a name is no plain file name or occurs twice, the format needs a second
  //                       file (.nhdr, .mhd), the size is 0, or that of the files is another one
  //   kPermissionDenied   a .vdb file, and options.vdb is false
  //   kTooLarge           above options.max_bytes or the memory budget
  //   kUnavailable        no space
  Upload(const UploadOptions& options, MemoryBudget& budget, const UploadStart& start);
  ~Upload();
  Upload(const Upload&) = delete;
  Upload& operator=(const Upload&) = delete;

  // Writes the next bytes. Throws kInvalidArgument (more bytes than announced), kUnavailable (no
  // space).
  void Append(std::string_view bytes);
  // Call it after the last Append. Throws kInvalidArgument (fewer bytes than announced, or a wrong
  // checksum), kUnavailable (no space).
  void Finish();

  // Of the file, or of the folder.
  const std::filesystem::path& path() const { return path_; }
  // The name in messages and in the volume's description: "upload:NAME".
  std::string title() const { return "upload:" + start_.name; }

 private:
  void Begin(const UploadFile& file);
  void End();
  void Write(std::string_view bytes);

  const UploadStart start_;
  MemoryClaim claim_;
  PrivateFolder folder_;
  std::filesystem::path path_;
  int file_ = -1;
  std::uint64_t file_left_bytes_ = 0;
  std::size_t files_begun_ = 0;
  std::uint64_t size_bytes_ = 0;  // received so far
  std::uint32_t crc32_ = 0;
};

// Removes the uploads of daemons that were killed. Call it at start.
void RemoveAbandonedUploads(const UploadOptions& options);

}  // namespace palpate
