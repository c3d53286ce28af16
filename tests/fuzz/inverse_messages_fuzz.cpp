// Anything that may answer on the ports of Haply's service: what is taken is finite, plain and
// whole, and what is sent stays a message. The input is the text.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "server/device/haply/inverse_link.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {
namespace {

void CheckId(const std::string& id) {
  FUZZ_CHECK(!id.empty() && id.size() <= 64);
  FUZZ_CHECK(id.find_first_of("\"\\{}\n") == std::string::npos);
}

void CheckReply(const InverseReply& reply) {
  for (const InverseArm& arm : reply.arms) {
    CheckId(arm.id);
    FUZZ_CHECK(arm.cursor_m.allFinite());
    FUZZ_CHECK(!arm.felt_n || arm.felt_n->allFinite());
    FUZZ_CHECK(arm.cursor_m.norm() < 10.0);
    FUZZ_CHECK(!arm.config || arm.config->about.find('\n') == std::string::npos);
  }
  for (const InverseGrip& grip : reply.grips) {
    CheckId(grip.id);
    FUZZ_CHECK(std::abs(grip.orientation.norm() - 1.0) < 1e-9);
    FUZZ_CHECK(grip.buttons < 8);
  }
  if (reply.arms.empty()) return;
  const InverseGrip grip = reply.grips.empty() ? InverseGrip{} : reply.grips.front();
  InverseWriter writer(reply.arms.front().id, grip);
  const std::string_view text = writer.Write(
      {.force_n = Vec3(-1e3, 1e3, -1e3), .wants_full_state = true, .is_before_3_5 = true});
  FUZZ_CHECK(text.front() == '{' && text.back() == '}');
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(inverse_messages_fuzz) {
  using namespace palpate;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (const auto reply = ParseInverse(text)) fuzz::CheckReply(*reply);
  if (const auto event = ParseInverseEvent(text)) {
    FUZZ_CHECK(event->text.find('\n') == std::string::npos);
  }
  if (const auto scale = ParseInverseForceScale(text)) FUZZ_CHECK(std::isfinite(*scale));
  ParseInverseVersion(text);
  return 0;
}
