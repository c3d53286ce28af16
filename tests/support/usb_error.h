// The BusError that a call must end with.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "server/device/usb/usb_link.h"

namespace palpate::test {

template <typename Call>
BusError BusErrorOf(const Call& call) {
  try {
    call();
  } catch (const BusError& error) {
    return error;
  }
  ADD_FAILURE() << "no BusError";
  return {BusFault::kBroken, ""};
}

inline bool Says(const BusError& error, const std::string& text) {
  return std::string(error.what()).find(text) != std::string::npos;
}

}  // namespace palpate::test
