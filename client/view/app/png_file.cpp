#include "client/view/app/png_file.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <png.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>

#include "common/error/error.h"

namespace palpate::view {
namespace {

[[noreturn]] void Refuse(const std::string& path, int error) {
  const ErrorKind kind = error == ENOENT || error == ENOTDIR || error == EISDIR
                             ? ErrorKind::kNotFound
                         : error == EACCES || error == EROFS ? ErrorKind::kPermissionDenied
                                                             : ErrorKind::kInternal;
  throw Error(kind, fmt::format("cannot write {}: {}", path, std::strerror(error)));
}

std::vector<std::uint8_t> WithoutAlpha(const Image& image) {
  std::vector<std::uint8_t> rgb;
  rgb.reserve(image.rgba.size() / 4 * 3);
  for (std::size_t i = 0; i + 3 < image.rgba.size(); i += 4) {
    rgb.insert(rgb.end(), image.rgba.begin() + static_cast<std::ptrdiff_t>(i),
               image.rgba.begin() + static_cast<std::ptrdiff_t>(i) + 3);
  }
  return rgb;
}

// Beside its name first, for a reader must never see half a picture.
std::string UnfinishedName(const std::string& path) {
  return fmt::format("{}.{}.part", path, getpid());
}

}  // namespace

void WritePng(const Image& image, const std::string& path) {
  const std::vector<std::uint8_t> rgb = WithoutAlpha(image);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.size.width);
  png.height = static_cast<png_uint_32>(image.size.height);
  png.format = PNG_FORMAT_RGB;
  const std::string unfinished = UnfinishedName(path);
  std::FILE* file = std::fopen(unfinished.c_str(), "wb");
  if (!file) Refuse(path, errno);
  errno = 0;
  bool written = png_image_write_to_stdio(&png, file, 0, rgb.data(), 0, nullptr) != 0;
  written = std::fclose(file) == 0 && written;
  written = written && std::rename(unfinished.c_str(), path.c_str()) == 0;
  if (written) return;
  const int error = errno == 0 ? EIO : errno;
  std::remove(unfinished.c_str());
  Refuse(path, error);
}

void RequireWritable(const std::string& path) {
  if (std::filesystem::is_directory(path)) Refuse(path, EISDIR);
  const std::string unfinished = UnfinishedName(path);
  std::FILE* file = std::fopen(unfinished.c_str(), "wb");
  if (!file) Refuse(path, errno);
  std::fclose(file);
  std::remove(unfinished.c_str());
}

std::string NewPictureName() {
  const std::string stem =
      fmt::format("palpate-{:%Y%m%d-%H%M%S}", fmt::localtime(std::time(nullptr)));
  std::string name = stem + ".png";
  for (int n = 2; std::filesystem::exists(name); ++n) name = fmt::format("{}-{}.png", stem, n);
  return name;
}

}  // namespace palpate::view
