#include "client/view/window/run.h"

// Must come before headers that include OpenGL's own header.
#include <epoxy/gl.h>

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <utility>

#include "client/program/interrupt.h"
#include "client/view/panels/interface.h"
#include "client/view/panels/widgets.h"
#include "client/view/render/frame_target.h"
#include "client/view/viewer/layout.h"
#include "client/view/viewer/preferences.h"
#include "client/view/viewer/viewer.h"
#include "client/view/window/frame_log.h"
#include "client/view/window/png_file.h"
#include "client/view/window/window_input.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

using Clock = std::chrono::steady_clock;

// At most 60 frames per second. A little shorter than 1/60 s, so that 60 Hz screens set the pace.
constexpr std::chrono::milliseconds kFrame(16);
constexpr std::chrono::milliseconds kLongestRest(250);
constexpr std::chrono::milliseconds kBrickTime(8);
// Room for the panels on both sides and a view between them.
constexpr ImageSize kLeast{640, 400};

class Glfw {
 public:
  Glfw() {
    // No callback: the error below has GLFW's text.
    glfwSetErrorCallback(nullptr);
    if (!glfwInit()) Refuse("cannot open a window");
  }
  ~Glfw() { glfwTerminate(); }
  Glfw(const Glfw&) = delete;
  Glfw& operator=(const Glfw&) = delete;

  [[noreturn]] static void Refuse(const char* what) {
    const char* why = nullptr;
    glfwGetError(&why);
    throw Error(ErrorKind::kUnavailable, fmt::format("{}: {}; without a display use --offscreen",
                                                     what, why ? why : "no reason is known"));
  }
};

struct CloseWindow {
  void operator()(GLFWwindow* window) const { glfwDestroyWindow(window); }
};
using WindowPtr = std::unique_ptr<GLFWwindow, CloseWindow>;

WindowPtr OpenWindow(const ImageSize& size) {
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
  // The limits hold only for later changes of the size.
  const int width = std::max(size.width, kLeast.width);
  const int height = std::max(size.height, kLeast.height);
  WindowPtr window(glfwCreateWindow(width, height, "Palpate", nullptr, nullptr));
  if (!window) Glfw::Refuse("cannot open a window with OpenGL 4.3");
  glfwSetWindowSizeLimits(window.get(), kLeast.width, kLeast.height, GLFW_DONT_CARE,
                          GLFW_DONT_CARE);
  glfwMakeContextCurrent(window.get());
  glfwSwapInterval(1);
  return window;
}

float ScaleOf(GLFWwindow* window) {
  float x = 1.0f;
  float y = 1.0f;
  glfwGetWindowContentScale(window, &x, &y);
  return std::max({1.0f, x, y});
}

// Returns the file's name.
std::string Save(const Image& picture) {
  const std::string name = NewPictureName();
  WritePng(picture, name, IfThere::kRefuse);
  return name;
}

void SavePictures(Viewer& viewer, const ImageSize& pixels, const ImageSize& view) {
  ViewState& state = viewer.state();
  const bool of_window = std::exchange(state.window_picture_wanted, false);
  const bool of_view = std::exchange(state.view_picture_wanted, false);
  if (!of_window && !of_view) return;
  try {
    std::string names;
    if (of_window) {
      // The picture that is about to be shown.
      glBindFramebuffer(GL_FRAMEBUFFER, 0);
      glReadBuffer(GL_BACK);
      names = Save({.size = pixels, .rgba = ReadRows(pixels)});
    }
    if (of_view) {
      viewer.DrawFine(view);
      names += (of_window ? " and " : "") + Save(viewer.renderer().ReadBack());
    }
    viewer.Say("saved " + names);
  } catch (const Error& error) {
    viewer.Say(error.what());
  }
}

// Keeps the preferences in the user's file. If that does not work, says so once.
class KeptPreferences {
 public:
  explicit KeptPreferences(Viewer& viewer) : viewer_(viewer), file_(PreferencesFile()) {
    if (file_.empty()) return;
    kept_ = ReadPreferences(file_);
    viewer_.preferences() = tried_ = kept_;
  }
  ~KeptPreferences() { Keep(); }
  KeptPreferences(const KeptPreferences&) = delete;
  KeptPreferences& operator=(const KeptPreferences&) = delete;

  // Not while the user drags: each step would be written.
  void KeepAtRest() {
    if (!ImGui::IsAnyMouseDown()) Keep();
  }

 private:
  void Keep() {
    Preferences& now = viewer_.preferences();
    if (file_.empty() || now == tried_) return;
    tried_ = now;
    try {
      const Preferences written = WriteChanges(kept_, now, file_);
      // The lists of other windows, but not how they look.
      now.recent_files = written.recent_files;
      now.saved_views = written.saved_views;
      kept_ = tried_ = now;
    } catch (const Error& error) {
      if (!std::exchange(said_, true)) viewer_.Say(std::string("not remembered: ") + error.what());
    }
  }

  Viewer& viewer_;
  const std::filesystem::path file_;
  Preferences kept_;   // as this window has read or written them last
  Preferences tried_;  // to write
  bool said_ = false;
};

// The title in the task bar.
std::string TitleOf(const Viewer& viewer) {
  const auto& lattice = viewer.feed().volume().lattice();
  if (viewer.feed().is_disconnected()) return "Palpate: not connected";
  switch (viewer.feed().connection().state) {
    case client::ConnectionState::kConnecting:
      return "Palpate: connecting";
    case client::ConnectionState::kLost:
      return lattice ? "Palpate: reconnecting" : "Palpate: not connected";
    case client::ConnectionState::kConnected:
      break;
  }
  if (!lattice) return "Palpate: no volume yet";
  return "Palpate: " + OneLine(std::filesystem::path(lattice->source).filename().string(), 200);
}

// Waits for the rest of a frame's time, or until a key or button needs a frame of its own.
void RestUntil(Clock::time_point end, const WindowInput& input) {
  for (auto now = Clock::now(); now < end && !input.is_urgent(); now = Clock::now()) {
    glfwWaitEventsTimeout(std::chrono::duration<double>(end - now).count());
  }
  glfwPollEvents();
}

// Waits until the frame is drawn. Takes the pointer's events meanwhile, because the hand that it
// leads does not wait for frames.
void Finish() {
  constexpr GLuint64 kPause_ns = 4'000'000;
  const GLsync drawn = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
  while (glClientWaitSync(drawn, GL_SYNC_FLUSH_COMMANDS_BIT, kPause_ns) == GL_TIMEOUT_EXPIRED) {
    glfwPollEvents();
  }
  glDeleteSync(drawn);
}

Clock::time_point EndOf(const Options& options) {
  if (options.seconds <= 0.0) return Clock::time_point::max();
  return Clock::now() + std::chrono::duration_cast<Clock::duration>(
                            std::chrono::duration<double>(options.seconds));
}

// True if the window is to be closed. While the user is asked about edits, it stays.
bool Closes(GLFWwindow* window, Viewer& viewer) {
  if (viewer.files().closes()) return true;
  if (!glfwWindowShouldClose(window)) return false;
  if (viewer.files().MayClose()) return true;
  glfwSetWindowShouldClose(window, GLFW_FALSE);
  return false;
}

}  // namespace

void RunWindow(const Options& options) {
  const Glfw glfw;
  const WindowPtr window = OpenWindow(options.size);
  Interface interface(ScaleOf(window.get()));
  Viewer viewer(options);
  KeptPreferences kept(viewer);
  WindowInput input(window.get(), viewer);
  FrameLog log;
  std::string title;
  const auto end = EndOf(options);
  while (!Closes(window.get(), viewer) && !Interrupt::IsRaised() && Clock::now() < end) {
    const auto frame = Clock::now();
    viewer.Update(kBrickTime);
    ImageSize pixels;
    glfwGetFramebufferSize(window.get(), &pixels.width, &pixels.height);
    if (pixels.width == 0 || pixels.height == 0) {  // iconified
      viewer.hand().GiveBack(viewer);
      RestUntil(frame + kLongestRest, input);
      continue;
    }
    if (const std::string now = TitleOf(viewer); now != title) {
      title = now;
      glfwSetWindowTitle(window.get(), title.c_str());
    }
    if (options.seconds > 0.0 && (log.frames() > 0 || viewer.complete())) log.Add(viewer);
    input.BeginFrame();
    interface.DrawFrame(viewer, input.TakeKeys(), pixels, 0);
    SavePictures(viewer, pixels, interface.view_pixels());
    kept.KeepAtRest();
    // Finish the work before the swap, which may wait for the screen.
    Finish();
    const auto worked = Clock::now() - frame;
    glfwSwapBuffers(window.get());
    // If frames are slow, as with software OpenGL, half of the time is left to other programs.
    RestUntil(frame + std::max<Clock::duration>(
                          kFrame, worked + std::min<Clock::duration>(worked, kLongestRest)),
              input);
  }
  if (options.seconds > 0.0) {
    fmt::print("{}\n", log.Line(viewer));
    std::fflush(stdout);
  }
}

}  // namespace palpate::view
