#include "server/client_paths/upload.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "common/error/error.h"
#include "common/files/new_file.h"

namespace palpate {
namespace {

constexpr std::string_view kFolderPrefix = "palpate-upload-";
constexpr std::size_t kLongestName = 200;
constexpr std::size_t kMostFiles = 65'536;

std::string Lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

bool IsPlainName(const std::string& name) {
  if (name.empty() || name.size() > kLongestName || name == "." || name == "..") return false;
  return std::none_of(name.begin(), name.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return c == '/' || byte < 0x20 || byte == 0x7f;
  });
}

// Checks in the order in which a client can correct the errors.
UploadStart Checked(const UploadStart& start, const UploadOptions& options) {
  if (!IsPlainName(start.name)) {
    Refuse("the name of an upload must be that of a file, without a folder, at most " +
           std::to_string(kLongestName) + " bytes, such as head.nii.gz");
  }
  const std::string name = Lower(start.name);
  if (!start.holds_voxels && (name.ends_with(".nhdr") || name.ends_with(".mhd"))) {
    Refuse(start.name + ": the voxels of this format are in another file; upload it as .nrrd or " +
           ".mha, which hold both");
  }
  if (!start.holds_voxels && !options.vdb && name.ends_with(".vdb")) {
    throw Error(ErrorKind::kPermissionDenied, start.name + ": .vdb files are not accepted here (" +
                                                  Upload::kVdbKey +
                                                  "); convert it to .nrrd and send that");
  }
  if (start.files.size() > kMostFiles) {
    throw Error(ErrorKind::kTooLarge, start.name + ": at most " + std::to_string(kMostFiles) +
                                          " files are possible; send a volume of one file");
  }
  std::uint64_t left_bytes = start.size_bytes;
  bool fits = true;
  for (const UploadFile& file : start.files) {
    if (!IsPlainName(file.name))
      Refuse(start.name + ": a file's name has a folder, or is too long");
    fits = fits && file.size_bytes <= left_bytes;
    if (fits) left_bytes -= file.size_bytes;
  }
  if (!start.files.empty() && (!fits || left_bytes > 0)) {
    Refuse(start.name + ": the sizes of its files are not that of all together");
  }
  if (start.size_bytes == 0) Refuse(start.name + ": there is nothing in it");
  if (start.size_bytes > options.max_bytes) {
    throw Error(ErrorKind::kTooLarge,
                start.name + ": " + std::to_string(start.size_bytes) +
                    " bytes are more than the limit of " + std::to_string(options.max_bytes) +
                    "; compress or crop the volume, or raise " + Upload::kMaxKey);
  }
  return start;
}

[[noreturn]] void FailToWrite(const std::filesystem::path& folder) {
  throw CannotWrite(folder / "the upload", errno);
}

}  // namespace

Upload::Upload(const UploadOptions& options, MemoryBudget& budget, const UploadStart& start)
    : start_(Checked(start, options)),
      claim_(budget.Claim("uploads", start.size_bytes)),
      folder_(options.folder, kFolderPrefix),
      path_(folder_.path() / start.name),
      crc32_(static_cast<std::uint32_t>(::crc32_z(0, nullptr, 0))) {
  if (start_.files.empty()) {
    Begin({.name = {}, .size_bytes = start_.size_bytes});
  } else if (mkdir(path_.c_str(), 0700) != 0) {
    FailToWrite(options.folder);
  }
}

Upload::~Upload() {
  if (file_ >= 0) close(file_);
}

void Upload::Append(std::string_view bytes) {
  if (bytes.size() > start_.size_bytes - size_bytes_) {
    Refuse(start_.name + ": there are more bytes than the " + std::to_string(start_.size_bytes) +
           " that were announced");
  }
  size_bytes_ += bytes.size();
  crc32_ = static_cast<std::uint32_t>(
      ::crc32_z(crc32_, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()));
  while (!bytes.empty()) {
    while (file_left_bytes_ == 0) Begin(start_.files[files_begun_++]);
    const std::size_t part = std::min<std::uint64_t>(bytes.size(), file_left_bytes_);
    Write(bytes.substr(0, part));
    bytes.remove_prefix(part);
    file_left_bytes_ -= part;
  }
}

void Upload::Begin(const UploadFile& file) {
  End();
  const std::filesystem::path path = start_.files.empty() ? path_ : path_ / file.name;
  file_ = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (file_ < 0 && errno == EEXIST) Refuse(start_.name + ": it has two files " + file.name);
  if (file_ < 0) FailToWrite(folder_.path().parent_path());
  file_left_bytes_ = file.size_bytes;
}

void Upload::End() {
  if (file_ >= 0 && close(std::exchange(file_, -1)) != 0) {
    FailToWrite(folder_.path().parent_path());
  }
}

void Upload::Write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t count = write(file_, bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) FailToWrite(folder_.path().parent_path());
    bytes.remove_prefix(static_cast<std::size_t>(count));
  }
}

void Upload::Finish() {
  if (size_bytes_ != start_.size_bytes) {
    Refuse(start_.name + ": only " + std::to_string(size_bytes_) + " of the " +
           std::to_string(start_.size_bytes) + " bytes that were announced have come");
  }
  if (crc32_ != start_.crc32) {
    Refuse(start_.name + ": the checksum is not the announced one; send it again");
  }
  End();
}

void RemoveAbandonedUploads(const UploadOptions& options) {
  RemoveAbandonedFolders(options.folder, kFolderPrefix);
}

}  // namespace palpate
