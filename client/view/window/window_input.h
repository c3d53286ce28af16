// Pointer and keys of a window, for Dear ImGui and for the viewer.
//
// Dear ImGui sees only the state at each frame. In a slow frame it would lose a click that begins
// and ends within the frame, and the motion before the click. So each change of a button gets a
// frame of its own here, after the frame with the motion. Only Esc, the button that stops the
// forces, and the hand that the pointer leads do not wait for a frame.
//
// Threads: main. Ownership: the window, the viewer and Dear ImGui's context must outlive it. Uses
// the window's user pointer.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "client/view/panels/input.h"

struct GLFWwindow;

namespace palpate::view {

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

}  // namespace palpate::view
