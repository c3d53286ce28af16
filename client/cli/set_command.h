// `palpate set ...`.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "palpate/v1/render.pb.h"

namespace palpate::cli {

class Connection;

// One setting to change.
struct SetOptions {
  v1::RenderSettings settings;
  // Name of the field of `settings` that is set.
  std::string field;
  std::optional<std::uint64_t> expected_revision;
  bool json = false;
};

// Changes it and prints since which tick it holds.
// Errors: as Connection::Call and WriteOutput; kConflict when the revision is
// another.
void ChangeSetting(const Connection& connection, const SetOptions& options);

// Such as "isovalue 40.8 applied at tick 123456, settings revision 7, 1.2 ms
// after receipt". Pure.
std::string DescribeChange(const std::string& field, const v1::UpdateSettingsResponse& response);

}  // namespace palpate::cli
