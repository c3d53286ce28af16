#include "client/web/app/config.h"

#include <boost/asio/ip/address.hpp>
#include <fstream>
#include <functional>

#include "client/web/app/secret_file.h"
#include "client/web/http/origins.h"
#include "client/web/logins/steering_rules.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

namespace fs = std::filesystem;

// Its publisher knows this gateway by its NATS user.
void CheckSteering(const Config& config) {
  if (config.nats.from.empty() || !config.nats.options.server.user.empty()) return;
  for (const User& user : config.users) {
    if (!user.may_steer.empty()) Refuse("user: " + user.name + " cannot steer without nats.user");
  }
}

void CheckListen(const HttpOptions& http) {
  boost::system::error_code problem;
  boost::asio::ip::make_address(http.listen.host, problem);
  if (problem && http.listen.host != "localhost") {
    Refuse("web.listen: " + http.listen.host + " is no IP address: give one, or localhost");
  }
}

void CheckReadable(const std::string& key, const fs::path& file) {
  if (!file.empty() && !std::ifstream(file)) {
    Refuse(key + ": cannot read " + file.string());
  }
}

void CheckPage(const fs::path& folder) {
  std::error_code error;
  if (!folder.empty() && !fs::exists(folder / "index.html", error)) {
    Refuse("web.page: " + folder.string() + " has no index.html");
  }
}

}  // namespace

std::vector<std::string> CheckConfig(const Config& config) {
  std::vector<std::string> faults;
  const auto attempt = [&](const std::function<void()>& check) {
    try {
      check();
    } catch (const Error& error) {
      faults.emplace_back(error.what());
    }
  };
  const HttpOptions& http = config.http;
  if (config.nats.from.empty()) attempt([&] { client::Resolve(config.palpated); });
  if (!config.room_key_file.empty()) attempt([&] { ReadRoomKey(config.room_key_file); });
  attempt([&] { Access({.room_key = NewSecret(128), .users = config.users}); });
  if (const std::string fault = WriteFault(http.key_file); !fault.empty()) faults.push_back(fault);
  attempt([&] { Origins(http, http.listen.port); });
  attempt([&] { CheckListen(http); });
  attempt([&] { CheckReadable("web.certificate", http.certificate_file); });
  attempt([&] { CheckReadable("web.key", http.key_file); });
  attempt([&] { CheckPage(http.page_folder); });
  if (http.certificate_file.empty() != http.key_file.empty()) {
    faults.emplace_back("web.certificate and web.key go together");
  }
  if (config.metrics && config.metrics->host != "localhost" && !IsLoopback(*config.metrics)) {
    faults.emplace_back(
        "metrics.listen: must be loopback (127.0.0.1, ::1): metrics are neither "
        "encrypted nor authorised");
  }
  attempt([&] { CheckSteering(config); });
  CheckNats(config.nats, attempt);
  if (!config.nats.from.empty() && !config.with_groups) {
    faults.emplace_back(
        "web.volume: guests of a room see what its publisher gives: set web.volume = false there");
  }
  return faults;
}

void CheckSettingKey(const std::string& key) {
  if (IsSetting(key)) return;
  Refuse(key + " is no setting: see the keys of palpate settings --json, and 'facing'");
}

std::string ReadRoomKey(const fs::path& file) {
  CheckSecretFile("room.key_file", file);
  std::ifstream stream(file);
  std::string key;
  stream >> key;
  if (key.size() < Access::kMinRoomKeyLength) {
    Refuse("room.key_file: " + file.string() + " needs a key of at least " +
           std::to_string(Access::kMinRoomKeyLength) + " characters: openssl rand -hex 16");
  }
  return key;
}

fs::path DefaultPageFolder() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path().parent_path();
  const fs::path of_build = folder / "web";
  return fs::exists(of_build / "index.html", error) ? of_build : folder / "share/palpate/web";
}

}  // namespace palpate::web
