// Who a client is, and what it may do.
//
// Threads: plain values.
#pragma once

#include <string>

#include "common/contract/enumerations.h"

namespace palpate {

// A recognised client. The name is unique among all ways to be recognised: "token lab-script",
// "certificate viewer.lab.example", "local socket".
struct Identity {
  std::string name{};
  Role role = Role::kViewer;
};

}  // namespace palpate
