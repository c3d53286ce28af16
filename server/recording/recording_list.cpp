#include "server/recording/recording_list.h"

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>
#include <tuple>

#include "common/error/error.h"
#include "server/recording/chunk_frame.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// A message holds UTF-8; a name need not be.
bool IsUtf8(std::string_view text) {
  for (std::size_t n = 0; n < text.size();) {
    const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[n + k]); };
    const std::size_t length = byte(0) < 0x80                      ? 1
                               : byte(0) >= 0xc2 && byte(0) < 0xe0 ? 2
                               : byte(0) >= 0xe0 && byte(0) < 0xf0 ? 3
                               : byte(0) >= 0xf0 && byte(0) < 0xf5 ? 4
                                                                   : 0;
    if (length == 0 || n + length > text.size()) return false;
    for (std::size_t k = 1; k < length; ++k) {
      if ((byte(k) & 0xc0) != 0x80) return false;
    }
    const bool too_long =
        (byte(0) == 0xe0 && byte(1) < 0xa0) || (byte(0) == 0xf0 && byte(1) < 0x90);
    const bool no_letter =
        (byte(0) == 0xed && byte(1) > 0x9f) || (byte(0) == 0xf4 && byte(1) > 0x8f);
    if (length > 1 && (too_long || no_letter)) return false;
    n += length;
  }
  return true;
}

void AddFiles(const fs::path& folder, std::vector<ListedRecording>& files) {
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    struct stat status {};
    // Follows links, as the client's Replay does.
    if (stat(it->path().c_str(), &status) != 0 || !S_ISREG(status.st_mode)) continue;
    if (!IsUtf8(it->path().native())) continue;
    files.push_back({it->path(), static_cast<std::uint64_t>(status.st_size),
                     static_cast<std::int64_t>(status.st_mtim.tv_sec)});
  }
}

bool BeginsAsRecording(std::istream& stream) {
  std::array<char, kRecordingMagic.size()> first{};
  stream.read(first.data(), first.size());
  return stream && std::string_view(first.data(), first.size()) == kRecordingMagic;
}

}  // namespace

std::vector<ListedRecording> FindRecordings(
    const std::vector<fs::path>& folders,
    const std::function<std::unique_ptr<std::istream>(const std::string&)>& open) {
  std::vector<ListedRecording> files;
  for (const fs::path& folder : folders) AddFiles(folder, files);
  const auto newer = [](const ListedRecording& a, const ListedRecording& b) {
    return std::tie(b.modified_s, a.path) < std::tie(a.modified_s, b.path);
  };
  std::sort(files.begin(), files.end(), newer);
  files.resize(std::min(files.size(), kMostFilesLookedAt));
  std::vector<ListedRecording> recordings;
  for (ListedRecording& file : files) {
    if (recordings.size() == kMostListedRecordings) break;
    try {
      if (BeginsAsRecording(*open(file.path.string()))) recordings.push_back(std::move(file));
    } catch (const Error&) {
      // Not for clients.
    }
  }
  return recordings;
}

}  // namespace palpate
