#include "server/import/tiff_stack.h"

#include <algorithm>
#include <bit>
#include <optional>
#include <string>

#include "server/import/data_check.h"
#include "server/import/image_header.h"
#include "server/import/tiff_page.h"

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

// Returns all TIFF files of the folder, ordered by number. Refuses several series, missing numbers
// and double numbers.
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

// Returns the slices of the series that starts with this file: all files of its folder whose names
// differ only in the last number. Returns only this file if its name has no number.
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

std::string Shape(const TiffPage& page) {
  return std::to_string(page.width) + "x" + std::to_string(page.height) + " " + Name(page.type);
}

// Checks each slice before the next one is opened: it must match the first slice, and the stack
// must stay within the limits.
class StackChecker {
 public:
  StackChecker(TiffStack* stack, const ImportLimits& limits) : stack_(stack), limits_(limits) {}

  void Add(TIFF* tiff, const std::string& slice) {
    const TiffPage page = CheckTiffPage(tiff);
    if (slices_ == 0) first_ = page;
    if (page != first_) {
      Refuse(slice + " is " + Shape(page) + " where the first is " + Shape(first_) +
             "; all slices must have one size and type");
    }
    ++slices_;
    stack_->header.type = page.type;
    stack_->header.size = {page.width, page.height, slices_};
    CheckedVoxelBytes(stack_->header.size, page.type, ReadType(stack_->header), limits_);
  }

  void Finish() const {
    if (slices_ < 2) {
      Refuse(
          "there is only one slice; give a file of several pages, or the folder or first file "
          "of a numbered series");
    }
    VolumeSize({first_.width, first_.height, slices_});
  }

 private:
  TiffStack* stack_;
  const ImportLimits& limits_;
  TiffPage first_;
  std::int64_t slices_ = 0;
};

void AddPages(TIFF* tiff, StackChecker* checker, TiffStack* stack) {
  for (std::uint32_t page = 0;; ++page) {
    if (!IsAuxiliaryPage(tiff)) {
      checker->Add(tiff, "page " + std::to_string(page + 1));
      stack->pages.push_back(page);
    }
    if (TIFFLastDirectory(tiff) != 0) return;
    // A damaged page must not end the volume without an error.
    if (TIFFReadDirectory(tiff) == 0) {
      Refuse("page " + std::to_string(page + 2) +
             " cannot be read; the file is damaged or truncated");
    }
  }
}

// Puts the pages into the order that OME states.
void OrderPages(const TiffDescription& description, TiffStack* stack) {
  const std::vector<std::int64_t>& order = description.page_of_slice;
  if (order.empty()) return;
  std::vector<std::int64_t> stated = order, present(stack->pages.begin(), stack->pages.end());
  std::ranges::sort(stated);
  if (!description.file_of_slice.empty() || stated != present) {
    Refuse(
        "the OME description states other slices than the pages of this file, or some in other "
        "files; save it as one file");
  }
  if (order == std::vector<std::int64_t>(stack->pages.begin(), stack->pages.end())) return;
  stack->pages.assign(order.begin(), order.end());
  stack->header.warnings.push_back(
      std::string("the slices are in the order that OME states, not in that of the pages") +
      kReadOtherwise);
}

// Files that are ordered by the numbers in their names may be ordered otherwise by OME.
void CheckOrder(const TiffDescription& description, const std::vector<fs::path>& files) {
  std::vector<std::string> stated = description.file_of_slice, present;
  for (const fs::path& file : files) present.push_back(file.filename().string());
  if (stated == present) return;
  std::ranges::sort(stated);
  if (stated == present) {
    Refuse(
        "the OME description orders the files otherwise than the numbers in their names; number "
        "them as it does, or save them as one file");
  }
}

bool HasSeveralPages(TIFF* tiff) { return TIFFLastDirectory(tiff) == 0; }

void AddFiles(StackChecker* checker, const TiffStack& stack) {
  for (const fs::path& path : stack.files) {
    const std::string name = "the slice " + Quoted(path.filename().string());
    try {
      const TiffFile file = OpenTiff(path);
      if (HasSeveralPages(file.get())) {
        Refuse("it has several pages; give the file alone, or save one file per slice");
      }
      const TiffDescription own = DescribeTiff(file.get());
      if (!own.problem.empty()) Refuse(own.problem);
      if (own.slope != stack.header.slope || own.intercept != stack.header.intercept) {
        Refuse("its values have another calibration than those of the first slice");
      }
      checker->Add(file.get(), "it");
    } catch (const Error& error) {
      throw Error(error.kind(), name + ": " + error.what());
    }
  }
}

// ImageJ writes more than 4 GB so.
void AddFollowing(TIFF* tiff, std::int64_t images, const ImportLimits& limits, TiffStack* stack) {
  const TiffPage page = CheckTiffPage(tiff);
  ImageHeader& header = stack->header;
  header.type = page.type;
  header.size = VolumeSize({page.width, page.height, images});
  header.begin = static_cast<std::int64_t>(TIFFGetStrileOffset(tiff, 0));
  header.big_endian = (TIFFIsByteSwapped(tiff) != 0) != (std::endian::native == std::endian::big);
  const std::int64_t bytes = CheckedVoxelBytes(header.size, page.type, ReadType(header), limits);
  if (bytes > static_cast<std::int64_t>(fs::file_size(stack->files.front())) - header.begin) {
    Refuse("the file of ImageJ states " + std::to_string(images) +
           " images, but has fewer; the file is truncated");
  }
  stack->has_one_page = true;
}

// As ImageJ writes images.
bool IsOnePlainStrip(TIFF* tiff) {
  std::uint16_t compression = COMPRESSION_NONE;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_COMPRESSION, &compression);
  return compression == COMPRESSION_NONE && TIFFIsTiled(tiff) == 0 && TIFFNumberOfStrips(tiff) == 1;
}

void CheckPlaces(const std::vector<fs::path>& files, const ImportLimits& limits) {
  for (const fs::path& file : files) CheckPlace(file, limits);
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

TiffStack OpenTiffStack(const fs::path& input, const ImportLimits& limits) {
  TiffStack stack;
  StackChecker checker(&stack, limits);
  const bool folder = fs::is_directory(input);
  stack.files = folder ? TiffFolderSlices(input) : std::vector<fs::path>{input};
  CheckPlaces(stack.files, limits);
  const TiffFile first = OpenTiff(stack.files.front());
  const TiffDescription description = DescribeTiff(first.get());
  if (!description.problem.empty()) Refuse(description.problem);
  if (description.spacing_mm) stack.header.geometry.spacing_mm = *description.spacing_mm;
  stack.states_spacing = description.spacing_mm.has_value();
  stack.header.slope = description.slope;
  stack.header.intercept = description.intercept;
  stack.header.unit = description.unit;
  stack.header.warnings = description.warnings;
  if (stack.files.size() == 1 && description.images > 1 && !HasSeveralPages(first.get()) &&
      IsOnePlainStrip(first.get())) {
    AddFollowing(first.get(), description.images, limits, &stack);
    return stack;
  }
  if (stack.files.size() == 1 && HasSeveralPages(first.get())) {
    AddPages(first.get(), &checker, &stack);
    OrderPages(description, &stack);
  } else {
    if (!folder) stack.files = TiffSeriesSlices(input);
    CheckPlaces(stack.files, limits);
    AddFiles(&checker, stack);
    CheckOrder(description, stack.files);
  }
  checker.Finish();
  return stack;
}

void ReadTiffVoxels(const TiffStack& stack, const std::function<void(double)>& progress,
                    const VoxelSink& sink) {
  if (stack.has_one_page) {
    ReadVoxels(stack.files.front(), stack.header, 0, sink);
    return progress(1.0);
  }
  const auto& size = stack.header.size;
  const TiffPage page{size[0], size[1], stack.header.type};
  ImageHeader decode = DecodeHeader(page);
  decode.slope = stack.header.slope;
  decode.intercept = stack.header.intercept;
  const LeafType type = ReadType(decode);
  const auto slice_voxels = static_cast<std::size_t>(size[0] * size[1]);
  std::vector<char> slice(slice_voxels * VoxelBytes(type));
  TiffFile file;
  for (std::int64_t z = 0; z < size[2]; ++z) {
    if (stack.pages.empty() || z == 0) {
      file = OpenTiff(stack.files[stack.pages.empty() ? static_cast<std::size_t>(z) : 0]);
    }
    bool there = true;
    if (!stack.pages.empty()) {
      const std::uint32_t wanted = stack.pages[static_cast<std::size_t>(z)];
      const auto present = TIFFCurrentDirectory(file.get());
      there = present == wanted       ? true
              : present + 1 == wanted ? TIFFReadDirectory(file.get()) != 0
                                      : TIFFSetDirectory(file.get(), wanted) != 0;
    }
    if (!there || CheckTiffPage(file.get()) != page) Refuse("the file changed while it was read");
    ReadTiffPage(file.get(), page, decode, slice.data());
    sink(type, slice.data(), slice_voxels);
    progress(static_cast<double>(z + 1) / static_cast<double>(size[2]));
  }
}

}  // namespace palpate
