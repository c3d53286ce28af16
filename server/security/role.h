// The roles of clients. Each role may do everything that the earlier roles may do.
//
// Threads: plain values.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

enum class Role {
  kViewer,    // watches: streams, and all calls that only read
  kEditor,    // changes settings, voxels and the volume's place
  kOperator,  // controls the device, and uses files of the workstation
  kAdmin,     // may do everything
};

inline constexpr std::array<std::string_view, 4> kRoleNames = {"viewer", "editor", "operator",
                                                               "admin"};

constexpr std::string_view NameOf(Role role) { return kRoleNames[static_cast<std::size_t>(role)]; }

// None if no role has this name.
constexpr std::optional<Role> RoleNamed(std::string_view name) {
  for (std::size_t n = 0; n < kRoleNames.size(); ++n) {
    if (kRoleNames[n] == name) return static_cast<Role>(n);
  }
  return std::nullopt;
}

// A recognised client. The name is unique among all ways to be recognised: "token lab-script",
// "certificate viewer.lab.example", "local socket".
struct Identity {
  std::string name{};
  Role role = Role::kViewer;
};

}  // namespace palpate
