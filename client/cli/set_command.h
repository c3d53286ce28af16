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

// What is felt of the settings' ball or tool, with the commands that make it fit; empty: that
// itself.
std::string TipInWords(client::Calls& palpated, const client::Settings& settings);

}  // namespace palpate::cli
