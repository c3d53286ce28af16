#include "client/view/window/run.h"

// Must come before headers that include OpenGL's own header.
#include <epoxy/gl.h>

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "client/program/interrupt.h"
#include "client/view/panels/input.h"
#include "client/view/panels/interface.h"
#include "client/view/panels/widgets.h"
#include "client/view/render/frame_target.h"
#include "client/view/viewer/layout.h"
#include "client/view/viewer/preferences.h"
#include "client/view/viewer/viewer.h"
#include "client/view/window/png_file.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

// Pointer and keys of a window, for Dear ImGui and for the viewer.
//
// Dear ImGui sees only the state at each frame. In a slow frame it would lose a click that begins
// and ends within the frame, and the motion before the click. So each change of a button gets a
// frame of its own here, after the frame with the motion. Only Esc, the button that stops the
// forces, and the hand that the pointer leads do not wait for a frame.
//
// Threads: main. Ownership: the window, the viewer and Dear ImGui's context must outlive it. Uses
// the window's user pointer.

class WindowInput {
 public:
  WindowInput(GLFWwindow* window, Viewer& viewer);
  ~WindowInput();
  WindowInput(const WindowInput&) = delete;
  WindowInput& operator=(const WindowInput&) = delete;

  // Gives Dear ImGui and the viewer the input of the next frame, except for keys.
  void BeginFrame();
  // True if a change of a button or a key waits for its frame.
  bool is_urgent() const;
  // Returns the keys since the last call; none while earlier clicks still wait.
  std::vector<KeyPress> TakeKeys();

 private:
  using Buttons = std::array<bool, 3>;
  struct PointerEvent {
    double x = 0.0;
    double y = 0.0;
    Buttons down{};
    bool ctrl = false;
    bool stopped = false;  // the last press of the left button was on STOP
  };

  struct WaitingKey {
    KeyPress press;
    std::uint64_t after = 0;  // the number of pointer events before it
  };

  // A key that went down, or a character. A key that is down for less than a frame is shown for
  // one. What is typed after a click waits for the click, which may open a text field.
  struct Typed {
    int key = -1;
    bool ctrl = false;  // was held with the key
    unsigned character = 0;
    std::uint64_t after = 0;  // the number of pointer events before it
  };

  static WindowInput& Of(GLFWwindow* window);
  void ReleaseKeys();
  void ShowTyped();
  void Wait(Typed typed);
  static void OnKey(GLFWwindow* window, int key, int scancode, int action, int modifiers);
  static void OnCharacter(GLFWwindow* window, unsigned character);
  static void OnButton(GLFWwindow* window, int button, int action, int modifiers);
  static void OnDrop(GLFWwindow* window, int count, const char** paths);
  static void OnMove(GLFWwindow* window, double x, double y);

  GLFWwindow* window_;
  Viewer& viewer_;
  std::vector<std::string> dropped_;  // paths
  Buttons down_{};                    // as Dear ImGui knows them
  PointerEvent newest_;
  std::deque<PointerEvent> waiting_;
  std::uint64_t shown_ = 0;  // number of pointer events shown so far
  std::vector<WaitingKey> keys_;
  std::deque<Typed> typed_;      // that no frame has shown yet
  std::vector<int> shown_keys_;  // whose press the last frame showed
};

constexpr float kDoubleClick_s = 0.3f;
// Keys with another name than what is printed on them.
constexpr std::array<std::pair<int, const char*>, 4> kNamedKeys = {
    {{GLFW_KEY_F1, "f1"}, {GLFW_KEY_F6, "f6"}, {GLFW_KEY_F12, "f12"}, {GLFW_KEY_DELETE, "delete"}}};

WindowInput::WindowInput(GLFWwindow* window, Viewer& viewer) : window_(window), viewer_(viewer) {
  glfwSetWindowUserPointer(window, this);
  glfwGetCursorPos(window, &newest_.x, &newest_.y);
  // Installed before Dear ImGui's callbacks, which then call these.
  glfwSetKeyCallback(window, OnKey);
  glfwSetMouseButtonCallback(window, OnButton);
  glfwSetCursorPosCallback(window, OnMove);
  glfwSetDropCallback(window, OnDrop);
  ImGui_ImplGlfw_InitForOpenGL(window, true);
  // Dear ImGui demands keys for this, which pictures without a window do not have.
  ImGui::GetIO().ConfigFlags |= ImGuiConfigFlags_NavEnableKeyboard;
  // Instead of Dear ImGui's own, which does not wait for clicks.
  glfwSetCharCallback(window, OnCharacter);
}

WindowInput::~WindowInput() { ImGui_ImplGlfw_Shutdown(); }

WindowInput& WindowInput::Of(GLFWwindow* window) {
  return *static_cast<WindowInput*>(glfwGetWindowUserPointer(window));
}

void WindowInput::BeginFrame() {
  ImGui_ImplGlfw_NewFrame();
  ReleaseKeys();
  ImGuiIO& io = ImGui::GetIO();
  // Each press and release has a frame of its own: slow frames must not part a double click.
  io.MouseDoubleClickTime = std::max(kDoubleClick_s, 5.0f * io.DeltaTime);
  bool moved = false;
  bool clicked = false;
  std::vector<Eigen::Vector2d>& way = viewer_.state().pointer_way;
  way.clear();
  while (!waiting_.empty()) {
    const PointerEvent event = waiting_.front();
    const bool changes = event.down != down_;
    // Show the end of the pointer's motion before the button is released.
    if (changes && moved) break;
    waiting_.pop_front();
    ++shown_;
    io.MousePos = {static_cast<float>(event.x), static_cast<float>(event.y)};
    down_ = event.down;
    viewer_.state().stop_was_pressed = event.stopped;
    if (changes) io.KeyCtrl = event.ctrl;
    way.emplace_back(event.x, event.y);
    clicked = changes;
    if (changes) break;
    moved = true;
  }
  if (!clicked) ShowTyped();
  for (std::size_t button = 0; button < down_.size(); ++button)
    io.MouseDown[button] = down_[button];
  viewer_.files().Drop(std::exchange(dropped_, {}));
}

// Keys are as they are, but for those whose press still waits.
void WindowInput::ReleaseKeys() {
  ImGuiIO& io = ImGui::GetIO();
  const auto is_down = [this](int key) { return glfwGetKey(window_, key) == GLFW_PRESS; };
  io.KeyCtrl = is_down(GLFW_KEY_LEFT_CONTROL) || is_down(GLFW_KEY_RIGHT_CONTROL);
  for (const int key : shown_keys_) io.KeysDown[key] = is_down(key);
  shown_keys_.clear();
  for (const Typed& typed : typed_) {
    if (typed.key >= 0) io.KeysDown[typed.key] = false;
  }
}

void WindowInput::ShowTyped() {
  ImGuiIO& io = ImGui::GetIO();
  bool is_first = true;
  while (!typed_.empty() && typed_.front().after <= shown_) {
    const Typed typed = typed_.front();
    // A frame has ctrl, or it has not. Ctrl may be up again when the frame begins.
    if (!std::exchange(is_first, false) && typed.ctrl != io.KeyCtrl) return;
    // The second press of a key gets a frame of its own, after one without it.
    if (typed.key >= 0 && (io.KeysDown[typed.key] || io.KeysDownDuration[typed.key] >= 0.0f))
      return;
    typed_.pop_front();
    io.KeyCtrl = typed.ctrl;
    if (typed.key < 0) {
      io.AddInputCharacter(typed.character);
    } else {
      io.KeysDown[typed.key] = true;
      shown_keys_.push_back(typed.key);
    }
  }
}

void WindowInput::Wait(Typed typed) {
  typed.after = shown_ + waiting_.size();
  typed_.push_back(typed);
}

bool WindowInput::is_urgent() const {
  return !keys_.empty() || !typed_.empty() ||
         std::any_of(waiting_.begin(), waiting_.end(),
                     [this](const PointerEvent& event) { return event.down != down_; });
}

std::vector<KeyPress> WindowInput::TakeKeys() {
  std::vector<KeyPress> taken;
  std::erase_if(keys_, [&](const WaitingKey& key) {
    const bool ready = key.after <= shown_;
    if (ready) taken.push_back(key.press);
    return ready;
  });
  return taken;
}

// Uses the letter printed on the key, so that ctrl+Z works on every keyboard layout.
void WindowInput::OnKey(GLFWwindow* window, int key, int scancode, int action, int modifiers) {
  if (action != GLFW_PRESS) return;
  const bool ctrl = (modifiers & GLFW_MOD_CONTROL) != 0;
  if (key >= 0 && key < IM_ARRAYSIZE(ImGuiIO::KeysDown)) {
    const bool is_ctrl = key == GLFW_KEY_LEFT_CONTROL || key == GLFW_KEY_RIGHT_CONTROL;
    Of(window).Wait({.key = key, .ctrl = ctrl || is_ctrl});
  }
  WindowInput& input = Of(window);
  if (key == GLFW_KEY_ESCAPE) {
    TakeEscape(input.viewer_);
    return;
  }
  KeyPress press{.key = {}, .ctrl = ctrl};
  const auto named = std::find_if(kNamedKeys.begin(), kNamedKeys.end(),
                                  [key](const auto& each) { return each.first == key; });
  if (named != kNamedKeys.end()) {
    press.key = named->second;
  } else if (const char* name = glfwGetKeyName(key, scancode)) {
    press.key = name;
  }
  // Some keyboards print digits for the shift key only.
  if (key >= GLFW_KEY_1 && key <= GLFW_KEY_6 && !press.ctrl) {
    const bool is_digit = press.key.size() == 1 && press.key >= "0" && press.key <= "9";
    if (!is_digit) press.key = static_cast<char>('1' + (key - GLFW_KEY_1));
  }
  input.keys_.push_back({press, input.shown_ + input.waiting_.size()});
}

void WindowInput::OnDrop(GLFWwindow* window, int count, const char** paths) {
  std::vector<std::string>& dropped = Of(window).dropped_;
  dropped.insert(dropped.end(), paths, paths + count);
}

void WindowInput::OnCharacter(GLFWwindow* window, unsigned character) {
  Of(window).Wait({.character = character});
}

void WindowInput::OnButton(GLFWwindow* window, int button, int action, int modifiers) {
  WindowInput& input = Of(window);
  if (button < 0 || button >= static_cast<int>(input.newest_.down.size())) return;
  input.newest_.down[static_cast<std::size_t>(button)] = action == GLFW_PRESS;
  input.newest_.ctrl = (modifiers & GLFW_MOD_CONTROL) != 0;
  // The pointer's place at the last event. GLFW's present place may already be farther.
  if (button == GLFW_MOUSE_BUTTON_LEFT && action == GLFW_PRESS) {
    input.newest_.stopped =
        input.viewer_.state().stop_button.Holds({input.newest_.x, input.newest_.y});
    if (input.newest_.stopped) {
      input.viewer_.state().hand.kept_buttons = 0;
      input.viewer_.feed().StopForces();
    }
  }
  if (button == GLFW_MOUSE_BUTTON_LEFT && action == GLFW_RELEASE) {
    input.viewer_.hand().ButtonReleased(input.viewer_.feed());
  }
  input.waiting_.push_back(input.newest_);
}

void WindowInput::OnMove(GLFWwindow* window, double x, double y) {
  WindowInput& input = Of(window);
  input.newest_.x = x;
  input.newest_.y = y;
  input.viewer_.hand().PointerMoved({x, y}, input.viewer_.feed());
  input.waiting_.push_back(input.newest_);
}

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

// Never larger than the screen: what stops the forces is in the upper right corner.
void KeepOnScreen(GLFWwindow* window) {
  GLFWmonitor* monitor = glfwGetPrimaryMonitor();
  if (!monitor) return;
  int x = 0, y = 0;
  ImageSize screen, now;
  glfwGetMonitorWorkarea(monitor, &x, &y, &screen.width, &screen.height);
  if (screen.width <= 0 || screen.height <= 0) return;
  glfwGetWindowSize(window, &now.width, &now.height);
  int left = 0, top = 0, right = 0, bottom = 0;
  glfwGetWindowFrameSize(window, &left, &top, &right, &bottom);
  const ImageSize most{screen.width - left - right, screen.height - top - bottom};
  glfwSetWindowSizeLimits(window, std::min(kLeast.width, most.width),
                          std::min(kLeast.height, most.height), GLFW_DONT_CARE, GLFW_DONT_CARE);
  if (now.width <= most.width && now.height <= most.height) return;
  glfwSetWindowSize(window, std::min(now.width, most.width), std::min(now.height, most.height));
  glfwSetWindowPos(window, x + left, y + top);
}

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
  KeepOnScreen(window.get());
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
