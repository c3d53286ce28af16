#include "server/recording/recording_list.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstddef>
#include <string_view>
#include <system_error>
#include <tuple>

#include "common/error/error.h"
#include "server/recording/recording_reader.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// The end of the year 9999: clients' calendars go no farther.
constexpr std::int64_t kMostSeconds = 253'402'300'799;

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

bool IsBefore(const ListedRecording& a, const ListedRecording& b) {
  return std::tie(b.modified_s, a.path) < std::tie(a.modified_s, b.path);
}

// Keeps only the newest `most` files, in no order.
void Shorten(std::size_t most, std::vector<ListedRecording>& files) {
  if (files.size() <= most) return;
  std::nth_element(files.begin(), files.begin() + static_cast<std::ptrdiff_t>(most), files.end(),
                   IsBefore);
  files.resize(most);
}

void AddFiles(const fs::path& folder, std::size_t most, std::vector<ListedRecording>& files) {
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    struct stat status {};
    // Follows links, as the client's Replay does.
    if (stat(it->path().c_str(), &status) != 0 || !S_ISREG(status.st_mode)) continue;
    if (!IsUtf8(it->path().native())) continue;
    files.push_back({it->path(), static_cast<std::uint64_t>(status.st_size),
                     std::clamp<std::int64_t>(status.st_mtim.tv_sec, 0, kMostSeconds)});
    // A folder of millions of files takes no more memory, and shortening takes little time for
    // each.
    if (files.size() >= 2 * most) Shorten(most, files);
  }
}

}  // namespace

std::vector<ListedRecording> FindRecordings(
    const std::vector<fs::path>& folders,
    const std::function<std::unique_ptr<std::istream>(const std::string&)>& open,
    const ListBounds& bounds) {
  std::vector<ListedRecording> files;
  for (const fs::path& folder : folders) AddFiles(folder, bounds.files, files);
  Shorten(bounds.files, files);
  std::sort(files.begin(), files.end(), IsBefore);
  std::vector<ListedRecording> recordings;
  for (ListedRecording& file : files) {
    if (recordings.size() == bounds.recordings) break;
    try {
      if (BeginsAsRecording(*open(file.path.string()))) recordings.push_back(std::move(file));
    } catch (const Error&) {
      // Not for clients.
    }
  }
  return recordings;
}

fs::path FolderForNew(const std::vector<fs::path>& folders) {
  return folders.empty() || !IsUtf8(folders.front().native()) ? fs::path() : folders.front();
}

}  // namespace palpate
