#include "client/view/window/png_file.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <png.h>

#include <ctime>
#include <filesystem>
#include <ios>

namespace palpate::view {

void WritePng(const Image& image, const std::string& path, IfThere if_there) {
  using Colors = Eigen::Matrix<std::uint8_t, 3, Eigen::Dynamic>;
  using ColorsWithAlpha = Eigen::Matrix<std::uint8_t, 4, Eigen::Dynamic>;
  const auto pixels = static_cast<Eigen::Index>(image.rgba.size() / 4);
  const Colors rgb = Eigen::Map<const ColorsWithAlpha>(image.rgba.data(), 4, pixels).topRows<3>();
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
