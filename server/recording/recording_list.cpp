#include "server/recording/recording_list.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <system_error>
#include <tuple>

#include "common/error/error.h"
#include "common/error/text.h"
#include "server/recording/recording_reader.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// The end of the year 9999: clients' calendars go no farther.
constexpr std::int64_t kMostSeconds = 253'402'300'799;

// A message holds UTF-8; a name need not be.
bool IsUtf8(const std::string& text) { return Utf8(text) == text; }

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
