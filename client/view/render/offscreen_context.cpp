#include "client/view/render/offscreen_context.h"

#include <epoxy/egl.h>

#include <string>

#include "common/error/error.h"

namespace palpate::view {
namespace {

constexpr char kWhatToInstall[] =
    "; install libegl1 and libgl1-mesa-dri, which draw in software where there is no graphics card";

// Returns EGL_NO_DISPLAY if the platform does not exist.
EGLDisplay Initialized(EGLDisplay display) {
  if (display == EGL_NO_DISPLAY) return EGL_NO_DISPLAY;
  return eglInitialize(display, nullptr, nullptr) ? display : EGL_NO_DISPLAY;
}

EGLDisplay SurfacelessDisplay() {
  if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless")) {
    return EGL_NO_DISPLAY;
  }
  return Initialized(
      eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
}

EGLDisplay DeviceDisplay() {
  if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_device") ||
      !epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_device_enumeration")) {
    return EGL_NO_DISPLAY;
  }
  EGLDeviceEXT device = nullptr;
  EGLint count = 0;
  if (!eglQueryDevicesEXT(1, &device, &count) || count < 1) return EGL_NO_DISPLAY;
  return Initialized(eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, device, nullptr));
}

// Makes a context and makes it current. Returns EGL_NO_CONTEXT if the display has no such OpenGL.
EGLContext CurrentContext(EGLDisplay display) {
  if (display == EGL_NO_DISPLAY || !eglBindAPI(EGL_OPENGL_API)) return EGL_NO_CONTEXT;
  const EGLint config_wish[] = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE,
                                EGL_OPENGL_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint configs = 0;
  if (!eglChooseConfig(display, config_wish, &config, 1, &configs) || configs < 1) {
    return EGL_NO_CONTEXT;
  }
  const EGLint context_wish[] = {EGL_CONTEXT_MAJOR_VERSION,
                                 4,
                                 EGL_CONTEXT_MINOR_VERSION,
                                 3,
                                 EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                 EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                 EGL_NONE};
  EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, context_wish);
  if (context == EGL_NO_CONTEXT) return EGL_NO_CONTEXT;
  if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) return context;
  eglDestroyContext(display, context);
  return EGL_NO_CONTEXT;
}

}  // namespace

OffscreenContext::OffscreenContext() {
  // epoxy would end the process if the library is missing.
  if (!epoxy_has_egl()) {
    throw Error(ErrorKind::kUnavailable,
                std::string("there is no EGL to draw without a display") + kWhatToInstall);
  }
  for (const auto find : {SurfacelessDisplay, DeviceDisplay}) {
    display_ = find();
    context_ = CurrentContext(display_);
    if (context_ != EGL_NO_CONTEXT) return;
  }
  throw Error(ErrorKind::kUnavailable,
              std::string("EGL gives no OpenGL 4.3 without a display") + kWhatToInstall);
}

OffscreenContext::~OffscreenContext() {
  // Do not terminate the display: it belongs to the whole process, and other code may use it.
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
}

}  // namespace palpate::view
