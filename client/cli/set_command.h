// `palpate set`, and what others need of it.
//
// Threads: main only.
#pragma once

#include <string>

#include "client/cli/invocation.h"
#include "client/cli/setting.h"

namespace palpate::cli {

// Stores "KEY=VALUE". Throws UsageError if there is no such setting, or if it has no such value.
void StoreNamedSetting(const std::string& text, client::SettingsUpdate& update);

// Returns text such as "isovalue 40.8 applied at tick 123456, settings revision 7, 1.2 ms after
// receipt". Pure.
std::string DescribeChange(const Setting& setting, const client::SettingsResult& result);

// Changes settings. What layers or a tool forbid is told with the commands that end it. Errors: as
// Calls::Set.
client::SettingsResult SetOrSayHow(client::Calls& palpated, const client::SettingsUpdate& update);

// Waits, with progress, until the ball or tool of `asked` is felt or has a problem: its fields are
// made in the background. Returns the settings then. Throws kConflict if somebody has set another.
client::Settings WaitForTip(client::Calls& palpated, const client::Settings& asked);

}  // namespace palpate::cli
