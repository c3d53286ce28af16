// A volume that a client sends, on its way to the importer.
//
// The importer wants a file with a name, whose suffix tells the format: it lies in a
// folder that only this user can enter, and both are removed with the object, also
// after a failure. What a killed daemon left is removed at the next start.
//
// Threads: one at a time. Errors: Error; the object is of no use then.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "server/state/private_folder.h"
#include "server/store/memory_budget.h"

namespace palpate {

struct UploadOptions {
  std::filesystem::path folder = TemporaryFolder();  // it may be in memory
  std::uint64_t max_bytes = std::uint64_t{4} << 30;
  bool vdb = true;  // .vdb files are taken
};

// As the client announced it.
struct UploadStart {
  std::string name;  // of a file, with its suffix
  std::uint64_t size_bytes = 0;
  std::uint32_t crc32 = 0;    // as of zlib
  bool holds_voxels = false;  // nothing but: any suffix will do
};

class Upload {
 public:
  static constexpr char kMaxKey[] = "volume.max_upload_mib";
  static constexpr char kVdbKey[] = "volume.upload_vdb";

  // Throws kInvalidArgument (a name that is none, or of a file that needs another
  // one; no bytes), kPermissionDenied (a .vdb where none may be sent), kTooLarge (the limit, the
  // budget), kUnavailable (no space).
  Upload(const UploadOptions& options, MemoryBudget& budget, const UploadStart& start);
  ~Upload();
  Upload(const Upload&) = delete;
  Upload& operator=(const Upload&) = delete;

  // The next bytes. kInvalidArgument (more than announced), kUnavailable (no space).
  void Append(std::string_view bytes);
  // After the last one. kInvalidArgument (fewer than announced, another checksum).
  void Finish();

  const std::filesystem::path& path() const { return path_; }
  // As messages and the volume's description name it: "upload:NAME".
  std::string title() const { return "upload:" + start_.name; }

 private:
  const UploadStart start_;
  MemoryClaim claim_;
  PrivateFolder folder_;
  std::filesystem::path path_;
  int file_ = -1;
  std::uint64_t size_bytes_ = 0;  // so far
  std::uint32_t crc32_ = 0;
};

// Of daemons that were killed; at start.
void RemoveAbandonedUploads(const UploadOptions& options);

}  // namespace palpate
