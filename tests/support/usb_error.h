// The UsbError that a call must end with.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "server/device/usb/usb_link.h"

namespace palpate::test {

template <typename Call>
UsbError UsbErrorOf(const Call& call) {
  try {
    call();
  } catch (const UsbError& error) {
    return error;
  }
  ADD_FAILURE() << "no UsbError";
  return {UsbFault::kBroken, ""};
}

inline bool Says(const UsbError& error, const std::string& text) {
  return std::string(error.what()).find(text) != std::string::npos;
}

}  // namespace palpate::test
