// `palpate set ...`.
#pragma once

#include <string>

#include "client/cli/setting.h"
#include "palpate/v1/render.pb.h"

namespace palpate::cli {

class Connection;

// One setting to change.
struct SetOptions {
  // Of all settings this one, and what it is expected to be on top of.
  const Setting* setting = nullptr;
  client::SettingsUpdate update;
  bool json = false;
};

// Changes it and prints since which tick it holds.
// Errors: as Connection::Call and WriteOutput; kConflict when the revision is
// another.
void ChangeSetting(const Connection& connection, const SetOptions& options);

// Such as "isovalue 40.8 applied at tick 123456, settings revision 7, 1.2 ms
// after receipt". Pure.
std::string DescribeChange(const Setting& setting, const v1::UpdateSettingsResponse& response);

}  // namespace palpate::cli
