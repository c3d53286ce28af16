// What only the gateway knows, as browsers get it: JSON with the topic's name as "type". The page's
// wire/messages.ts has their members.
//
// Text of other machines (names, reasons) is without control characters and valid UTF-8. Numbers
// that are not finite are null. Times: ms of the Unix epoch. Threads: pure.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/connection.h"
#include "client/sdk/placement.h"
#include "client/sdk/settings.h"
#include "client/sdk/volume.h"
#include "client/sdk/volume_update.h"
#include "client/web/volume/grouped_volume.h"
#include "common/error/error.h"

namespace palpate::web {

struct HelloInfo {
  std::string version{};
  std::string user{};
  std::vector<std::string> may_steer{};
  bool may_stop = true;
  std::int64_t server_time_ms = 0;
};
std::string HelloText(const HelloInfo& info);

// What guests may know of a loss and of a refusal: never the socket's path or an address, which the
// reasons of the client library name. Empty: nothing is wrong.
std::string PlainWhy(client::ConnectionState state);
std::string PlainProblem(const client::VolumeStatus& status);
std::string PlainRefusal(const Error& refusal);  // of a change of a setting

// `palpated`: its name for people. `why` is shown as it is; "" if connected.
std::string ConnectionText(client::ConnectionState state, const std::string& why,
                           const std::string& palpated, std::int64_t since_ms);

// `is_loading`: `problem` says how far palpated's first volume is.
std::string CopyText(std::uint64_t bricks_left, const std::string& problem, bool is_loading);
std::string ManifestText(const ManifestInfo& manifest);

struct SteeredChange {
  std::string user;
  std::string key;
  double value = 0.0;
  std::int64_t time_ms = 0;
};
std::string SteeringText(const std::deque<SteeredChange>& changes);

// None if there is no such setting, or if it does not take the value: flags are 0 or 1, choices the
// number of a word. The daemon checks the ranges of numbers.
std::optional<client::SettingsUpdate> UpdateOf(const std::string& key, double value);
// None for another key than kFacingKey, and for another value than its.
std::optional<client::PatientFacing> FacingOf(const std::string& key, double value);

}  // namespace palpate::web
