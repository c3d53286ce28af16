// An OpenGL 4.3 core context without a window or a display: EGL on Mesa's surfaceless
// platform, or else on the first device.
//
// Threads: current on the thread that made it, until it is destroyed.
// Errors: kUnavailable if the machine has no such driver.
#pragma once

namespace palpate::view {

class OffscreenContext {
 public:
  OffscreenContext();
  ~OffscreenContext();
  OffscreenContext(const OffscreenContext&) = delete;
  OffscreenContext& operator=(const OffscreenContext&) = delete;

 private:
  // EGLDisplay and EGLContext.
  void* display_ = nullptr;
  void* context_ = nullptr;
};

}  // namespace palpate::view
