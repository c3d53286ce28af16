#include "client/view/window/window_input.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <utility>

namespace palpate::view {
namespace {

constexpr float kDoubleClick_s = 0.3f;
// Keys with another name than what is printed on them.
constexpr std::array<std::pair<int, const char*>, 4> kNamedKeys = {
    {{GLFW_KEY_F1, "f1"}, {GLFW_KEY_F6, "f6"}, {GLFW_KEY_F12, "f12"}, {GLFW_KEY_DELETE, "delete"}}};

}  // namespace

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
    if (input.newest_.stopped) input.viewer_.feed().StopForces();
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

}  // namespace palpate::view
