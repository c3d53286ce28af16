#include "client/view/app/png_file.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <png.h>

#include <ctime>
#include <filesystem>
#include <ios>

namespace palpate::view {
namespace {

std::vector<std::uint8_t> WithoutAlpha(const Image& image) {
  std::vector<std::uint8_t> rgb;
  rgb.reserve(image.rgba.size() / 4 * 3);
  for (std::size_t i = 0; i + 3 < image.rgba.size(); i += 4) {
    rgb.insert(rgb.end(), image.rgba.begin() + static_cast<std::ptrdiff_t>(i),
               image.rgba.begin() + static_cast<std::ptrdiff_t>(i) + 3);
  }
  return rgb;
}

}  // namespace

void WritePng(const Image& image, const std::string& path, IfThere if_there) {
  const std::vector<std::uint8_t> rgb = WithoutAlpha(image);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.size.width);
  png.height = static_cast<png_uint_32>(image.size.height);
  png.format = PNG_FORMAT_RGB;
  const auto write = [&](const std::filesystem::path& partial) {
    if (png_image_write_to_file(&png, partial.c_str(), 0, rgb.data(), 0, nullptr) == 0) {
      throw std::ios_base::failure(png.message);
    }
  };
  // Not durable: a window must not wait for the disk.
  WriteWhole(path, write, if_there, Durable::kNo);
}

std::string NewPictureName() {
  const std::string stem =
      fmt::format("palpate-{:%Y%m%d-%H%M%S}", fmt::localtime(std::time(nullptr)));
  std::string name = stem + ".png";
  for (int n = 2; std::filesystem::exists(name); ++n) name = fmt::format("{}-{}.png", stem, n);
  return name;
}

}  // namespace palpate::view
