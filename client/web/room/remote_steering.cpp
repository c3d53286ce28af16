#include "client/web/room/remote_steering.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "client/sdk/server_choice.h"

namespace palpate::web {

std::variant<SteerRequest, std::string> RemoteSteering::Judge(const std::string& site,
                                                              std::string_view json, Time now) {
  const auto found = std::find_if(sites_.begin(), sites_.end(),
                                  [&](const RemoteSite& one) { return one.name == site; });
  if (found == sites_.end()) return "this site may not steer";
  SteerRequest request;
  try {
    const auto read = nlohmann::json::parse(json);
    request.user = read.at("user").get<std::string>();
    request.key = read.at("key").get<std::string>();
    request.value = read.at("value").get<double>();
  } catch (const nlohmann::json::exception&) {
    return "the request makes no sense";
  }
  if (!client::IsProfileName(request.user)) return "the user has no name that can be logged";
  const Session session{.user = site, .may_steer = found->may_steer, .network = {}, .ends = {}};
  std::string refusal = rules_.Refusal(session, request.key, request.value, now);
  if (!refusal.empty()) return refusal;
  request.user += "@" + site;
  return request;
}

std::string SteerAnswer(const std::string& error) {
  return nlohmann::json{{"error", error}}.dump(-1, ' ', false,
                                               nlohmann::json::error_handler_t::replace);
}

}  // namespace palpate::web
