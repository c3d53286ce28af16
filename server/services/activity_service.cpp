#include "server/services/activity_service.h"

#include "common/contract/activity.h"
#include "common/wire/values.h"
#include "server/door/activity.h"
#include "server/log/line_budget.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

double SecondsSince(std::int64_t time_ns, std::int64_t now_ns) {
  return 1e-9 * static_cast<double>(now_ns - time_ns);
}

}  // namespace

v1::GetActivityResponse ToProto(const Activity& activity) {
  v1::GetActivityResponse out;
  const std::int64_t now_ns = MonotonicNowNs();
  for (const Activity::Caller& caller : activity.callers(now_ns)) {
    *out.add_callers() =
        ToProto(ConnectedCaller{.caller = {caller.identity.name, caller.identity.role},
                                .peer = PeerInWords(caller.address),
                                .connected_s = SecondsSince(caller.came_ns, now_ns),
                                .watches = caller.watches});
  }
  for (const Activity::Change& change : activity.changes()) {
    *out.add_changes() =
        ToProto(LastChange{change.what, change.by, SecondsSince(change.time_ns, now_ns)});
  }
  return out;
}

void MarkCaller(const Admission& you, v1::GetActivityResponse& activity) {
  const std::string peer = PeerInWords(AddressOf(you.peer()));
  for (v1::ConnectedCaller& caller : *activity.mutable_callers()) {
    caller.set_is_you(caller.peer() == peer && caller.caller().identity() == you.caller().name);
  }
}

Reply* ActivityService::GetActivity(CallContext* context, const v1::GetActivityRequest* request,
                                    v1::GetActivityResponse* response) {
  return calls_.Answer(context, "/palpate.v1.ActivityService/GetActivity", *request, *response,
                       [=, this](const Admission& you) {
                         *response = ToProto(calls_.access().activity());
                         MarkCaller(you, *response);
                       });
}

}  // namespace palpate
