// Draws the volume of a palpated as palpate-view does, and writes how far the surface is from the
// eye in each pixel. The browser's page is compared with it.
//
//   view_distances SOCKET WIDTH HEIGHT AZIMUTH_DEG ELEVATION_DEG DISTANCE_MM X Y Z OUT
//
// X Y Z: the target in mm of the device. OUT: floats in mm, the top row first, infinite where there
// is no surface; then, in the same way, the picture without overlays as RGBA bytes.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "client/view/drawing/patient_axes.h"
#include "client/view/palpated/live_feed.h"
#include "client/view/render/frame_renderer.h"
#include "client/view/render/offscreen_context.h"

namespace palpate::view {
namespace {

constexpr std::chrono::seconds kPatience(60);
constexpr std::size_t kBricksAtOnce = 4096;

void AwaitVolume(LiveFeed& feed) {
  feed.AwaitWhole();
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (true) {
    feed.Poll();
    const ViewVolume& volume = feed.volume();
    if (volume.lattice() && volume.X_DI() && volume.bricks_left() == 0 && feed.settings()) return;
    if (std::chrono::steady_clock::now() > end) throw std::runtime_error("no volume came");
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

Camera CameraOf(const std::vector<double>& numbers, const ViewVolume& volume) {
  Camera camera;
  const PatientFrame frame = PatientFrameOf(volume);
  if (frame.is_known) {
    camera.SetUpright(UprightPatient(volume.X_DI()->linear, frame.X_PI.linear));
  }
  camera.Set({numbers[5], numbers[6], numbers[7]}, numbers[2], numbers[3], numbers[4]);
  return camera;
}

void DrawWhole(FrameRenderer& renderer, ViewVolume& volume, const FrameRequest& request) {
  std::uint64_t before = 0;
  do {
    before = renderer.volume_version();
    while (!renderer.TakeUp(volume, kBricksAtOnce)) {
    }
    renderer.Draw(request);
    while (!renderer.TakeUp(volume, kBricksAtOnce)) {
    }
  } while (renderer.volume_version() != before);
}

void Main(const std::string& socket, const std::vector<double>& numbers, const char* out) {
  LiveFeed feed(client::ServerChoice{.address = {.socket_path = socket}});
  AwaitVolume(feed);
  const OffscreenContext context;
  FrameRenderer renderer;
  FrameRequest request{
      .size = {static_cast<int>(numbers[0]), static_cast<int>(numbers[1])},
      .camera = CameraOf(numbers, feed.volume()),
      .surface = {.isovalue = feed.settings()->isovalue,
                  .free_above = feed.settings()->free_side == client::FreeSide::kAbove}};
  DrawWhole(renderer, feed.volume(), request);
  const std::vector<float> distances = renderer.SurfaceDistances();
  const Image image = renderer.ReadBack();
  std::ofstream file(out, std::ios::binary);
  file.write(reinterpret_cast<const char*>(distances.data()),
             static_cast<std::streamsize>(distances.size() * sizeof(float)));
  file.write(reinterpret_cast<const char*>(image.rgba.data()),
             static_cast<std::streamsize>(image.rgba.size()));
  if (!file.flush()) throw std::runtime_error(std::string("cannot write ") + out);
}

}  // namespace
}  // namespace palpate::view

int main(int argc, char** argv) {
  try {
    if (argc != 11) throw std::runtime_error("wrong usage: see its source");
    std::vector<double> numbers;
    for (int n = 2; n < 10; ++n) numbers.push_back(std::stod(argv[n]));
    palpate::view::Main(argv[1], numbers, argv[10]);
    std::fflush(nullptr);
    std::_Exit(0);  // without the clean-up of libraries, as palpate-view
  } catch (const std::exception& error) {
    std::fprintf(stderr, "view_distances: %s\n", error.what());
    return 1;
  }
}
