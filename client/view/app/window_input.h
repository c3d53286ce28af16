// Pointer and keys of a window, for Dear ImGui and for us.
//
// Dear ImGui sees the state at each frame, and would lose a click that begins and ends
// within a slow one, and the way to where it ends: here each change of a button gets a
// frame of its own, after that of the way to it.
//
// Threads: main. Ownership: the window and Dear ImGui's context outlive it; takes the
// window's user pointer.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <vector>

#include "client/view/app/input.h"

struct GLFWwindow;

namespace palpate::view {

class WindowInput {
 public:
  // `stop`: called from within the key's event, whatever frames do.
  WindowInput(GLFWwindow* window, std::function<void()> stop);
  ~WindowInput();
  WindowInput(const WindowInput&) = delete;
  WindowInput& operator=(const WindowInput&) = delete;

  // Tells Dear ImGui what is to be seen in the next frame.
  void BeginFrame();
  // A change of a button or a key waits for its frame.
  bool is_urgent() const;
  // Since the last call; none before clicks that came earlier.
  std::vector<KeyPress> TakeKeys();
  // Of the pointer, in what BeginFrame told: its places, pixels of the screen.
  const std::vector<Eigen::Vector2d>& way() const { return way_; }

 private:
  using Buttons = std::array<bool, 3>;
  struct PointerEvent {
    double x = 0.0;
    double y = 0.0;
    Buttons down{};
  };

  struct WaitingKey {
    KeyPress press;
    std::uint64_t after = 0;  // so many events of the pointer
  };

  static WindowInput& Of(GLFWwindow* window);
  static void OnKey(GLFWwindow* window, int key, int scancode, int action, int modifiers);
  static void OnButton(GLFWwindow* window, int button, int action, int modifiers);
  static void OnMove(GLFWwindow* window, double x, double y);

  std::function<void()> stop_;
  std::vector<Eigen::Vector2d> way_;
  Buttons down_{};  // as Dear ImGui has them
  PointerEvent newest_;
  std::deque<PointerEvent> waiting_;
  std::uint64_t shown_ = 0;  // events of the pointer, so far
  std::vector<WaitingKey> keys_;
};

}  // namespace palpate::view
