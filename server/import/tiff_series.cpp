#include "server/import/tiff_series.h"

#include <algorithm>
#include <optional>

#include "server/import/image_header.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// A longer number is no slice count and could overflow.
constexpr std::size_t kMostDigits = 15;

// A file name, split at its last number.
struct SliceName {
  fs::path path;
  std::string before;
  std::string after;
  std::int64_t number = 0;

  bool IsOfSeries(const SliceName& other) const {
    return before == other.before && after == other.after;
  }
};

std::optional<SliceName> Split(const fs::path& path) {
  constexpr std::string_view kDigits = "0123456789";
  const std::string stem = path.stem().string();
  const std::size_t last = stem.find_last_of(kDigits);
  if (last == std::string::npos) return std::nullopt;
  const std::size_t before = stem.find_last_not_of(kDigits, last);
  const std::size_t first = before == std::string::npos ? 0 : before + 1;
  const std::size_t digits = last + 1 - first;
  if (digits > kMostDigits) return std::nullopt;
  SliceName name;
  name.path = path;
  name.before = stem.substr(0, first);
  name.after = stem.substr(last + 1) + path.extension().string();
  name.number = ParseInteger(std::string_view(stem).substr(first, digits), "file name");
  return name;
}

std::vector<fs::path> VisibleFiles(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const bool hidden = entry.path().filename().string().starts_with('.');
    if (!hidden && entry.is_regular_file(error)) files.push_back(entry.path());
  }
  if (error) Refuse("the folder cannot be listed: " + error.message());
  return files;
}

std::vector<fs::path> InOrder(std::vector<SliceName> slices) {
  std::sort(slices.begin(), slices.end(),
            [](const SliceName& a, const SliceName& b) { return a.number < b.number; });
  std::vector<fs::path> files;
  for (std::size_t k = 0; k < slices.size(); ++k) {
    files.push_back(slices[k].path);
    if (k == 0) continue;
    const std::int64_t step = slices[k].number - slices[k - 1].number;
    const std::string between = FileName(slices[k - 1].path) + " and " + FileName(slices[k].path);
    if (step == 0) Refuse(between + " have the same number; remove one of them");
    if (step > 1) {
      Refuse(std::to_string(step - 1) + " slices are missing between " + between +
             "; add them or number the files without gaps");
    }
  }
  return files;
}

}  // namespace

bool IsTiffName(const fs::path& path) {
  const std::string extension = Lower(path.extension().string());
  return extension == ".tif" || extension == ".tiff";
}

bool IsTiffFolder(const fs::path& folder) {
  const auto files = VisibleFiles(folder);
  return 2 * std::count_if(files.begin(), files.end(), IsTiffName) > std::ssize(files);
}

std::vector<fs::path> TiffFolderSlices(const fs::path& folder) {
  std::vector<fs::path> files = VisibleFiles(folder);
  std::erase_if(files, [](const fs::path& path) { return !IsTiffName(path); });
  // Sorted, so that messages do not depend on the folder's order.
  std::sort(files.begin(), files.end());
  if (files.size() == 1) return files;
  std::vector<SliceName> slices;
  for (const fs::path& file : files) {
    auto slice = Split(file);
    if (!slice) Refuse("the slice " + FileName(file) + " has no number in its name; rename it");
    if (!slices.empty() && !slice->IsOfSeries(slices.front())) {
      Refuse(FileName(slices.front().path) + " and " + FileName(file) +
             " are of different series; give each a folder, or the first file of one");
    }
    slices.push_back(std::move(*slice));
  }
  return InOrder(std::move(slices));
}

std::vector<fs::path> TiffSeriesSlices(const fs::path& first) {
  const auto start = Split(first);
  if (!start) return {first};
  const fs::path folder = first.has_parent_path() ? first.parent_path() : fs::path(".");
  std::vector<SliceName> slices;
  for (const fs::path& file : VisibleFiles(folder)) {
    auto slice = Split(file);
    if (slice && slice->IsOfSeries(*start)) slices.push_back(std::move(*slice));
  }
  const std::vector<fs::path> files = InOrder(std::move(slices));
  if (!files.empty() && files.front().filename() != first.filename()) {
    Refuse("this is not the first slice of its series; give " + FileName(files.front()) +
           ", or the folder");
  }
  return files;
}

}  // namespace palpate
