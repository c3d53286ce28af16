#include "client/cli/proof.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <sstream>

namespace palpate::cli {
namespace {

Json ScrubbedOf(const Json& json) {
  if (json.is_string()) return WithoutPaths(json.get<std::string>());
  Json scrubbed = json;
  if (json.is_structured()) {
    for (auto item = scrubbed.begin(); item != scrubbed.end(); ++item) *item = ScrubbedOf(*item);
  }
  return scrubbed;
}

Json ServoJson(const client::ServoDescription& servo) {
  return {{"rate_hz", servo.rate_hz},
          {"realtime_scheduling", servo.realtime_scheduling},
          {"memory_locked", servo.memory_locked},
          {"ticks", servo.ticks},
          {"missed_ticks", servo.missed_ticks}};
}

}  // namespace

std::string WithoutPaths(const std::string& text) {
  constexpr const char* kBefore = "\"'`(<=:";
  std::istringstream words(text);
  std::string kept;
  bool was_path = false;
  for (std::string word; std::getline(words, word, ' ');) {
    const std::string bare = word.substr(std::min(word.find_first_not_of(kBefore), word.size()));
    const bool begins_path = bare.size() > 1 && (bare[0] == '/' || bare[0] == '~');
    const bool holds_path =
        word.find("=/") != std::string::npos || word.find(":/") != std::string::npos;
    // A path with spaces is several words.
    const bool goes_on = was_path && word.find('/') != std::string::npos;
    if (!begins_path && !holds_path && !goes_on) {
      kept += " " + word;
    } else if (!was_path) {
      kept += " PATH";
    }
    was_path = begins_path || holds_path || goes_on;
  }
  return kept.empty() ? kept : kept.substr(1);
}

Json ToJson(const Proof& proof, const ProofVersions& versions) {
  Json json = {
      {"what", "palpate device prove"},
      {"rehearsal", proof.rehearsal},
      {"proposed_level", NameOf(proof.level)},
      {"note", "A proposal: a person of the project must look at it before the level is raised."},
      {"ended_at", proof.step},
      {"refusal", proof.refusal ? Json(proof.refusal->what()) : Json()},
      {"steps", proof.steps},
      {"versions",
       {{"palpate", versions.client},
        {"palpated", proof.daemon.servo.version},
        {"contract", "palpate.v1"},
        {"kernel", versions.kernel},
        {"machine", versions.machine},
        {"system", versions.system}}},
      {"device", ToJson(proof.daemon.device)},
      {"health", ToJson(proof.daemon.health)},
      {"forces", ToJson(proof.daemon.forces)},
      {"servo", ServoJson(proof.daemon.servo)},
      {"devices", ToJson(proof.devices)}};
  return ScrubbedOf(json);
}

std::string TableOf(const std::vector<client::Pose>& readings) {
  std::string table =
      "tick,ms,x_mm,y_mm,z_mm,qw,qx,qy,qz,buttons,force_x_n,force_y_n,force_z_n,forces\n";
  for (const client::Pose& pose : readings) {
    const Vec3& p_mm = pose.hip_mm;
    const Vec3& f_n = pose.force_n;
    const auto& q = pose.stylus_orientation;
    fmt::format_to(std::back_inserter(table),
                   "{},{:.3f},{:.4f},{:.4f},{:.4f},{:.5f},{:.5f},{:.5f},{:.5f},{},{:.4f},{:.4f},"
                   "{:.4f},{}\n",
                   pose.tick, 1e-6 * static_cast<double>(pose.time_ns - readings[0].time_ns),
                   p_mm.x(), p_mm.y(), p_mm.z(), q.w(), q.x(), q.y(), q.z(), pose.buttons, f_n.x(),
                   f_n.y(), f_n.z(), NameOf(pose.forces.state));
  }
  return table;
}

}  // namespace palpate::cli
