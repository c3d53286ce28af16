// Who may do how much: each role may do all that the ones before it may.
//
// Threads: plain values.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

enum class Role {
  kViewer,    // watches: streams, and all that only asks
  kEditor,    // changes what is felt and seen: settings, voxels, place
  kOperator,  // the device, and files of the workstation
  kAdmin,     // all
};

inline constexpr std::array<std::string_view, 4> kRoleNames = {"viewer", "editor", "operator",
                                                               "admin"};

constexpr std::string_view NameOf(Role role) { return kRoleNames[static_cast<std::size_t>(role)]; }

// None: there is none of that name.
constexpr std::optional<Role> RoleNamed(std::string_view name) {
  for (std::size_t n = 0; n < kRoleNames.size(); ++n) {
    if (kRoleNames[n] == name) return static_cast<Role>(n);
  }
  return std::nullopt;
}

// Somebody who was recognised. The name is unique among all ways of being recognised:
// "token lab-script", "certificate viewer.lab.example", "local socket".
struct Identity {
  std::string name{};
  Role role = Role::kViewer;
};

}  // namespace palpate
