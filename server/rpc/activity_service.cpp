#include "server/rpc/activity_service.h"

#include "common/contract/activity.h"
#include "common/wire/values.h"
#include "server/log/line_budget.h"
#include "server/realtime/tick_timer.h"
#include "server/rpc/activity.h"

namespace palpate {
namespace {

double SecondsSince(std::int64_t time_ns, std::int64_t now_ns) {
  return 1e-9 * static_cast<double>(now_ns - time_ns);
}

}  // namespace

Reply* ActivityService::GetActivity(CallContext* context, const v1::GetActivityRequest* request,
                                    v1::GetActivityResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.ActivityService/GetActivity", *request, *response,
      [=, this](const Admission& you) {
        const Activity& activity = calls_.access().activity();
        const std::int64_t now_ns = MonotonicNowNs();
        for (const Activity::Caller& caller : activity.callers(now_ns)) {
          *response->add_callers() =
              ToProto(ConnectedCaller{.caller = {caller.identity.name, caller.identity.role},
                                      .peer = PeerInWords(caller.address),
                                      .connected_s = SecondsSince(caller.came_ns, now_ns),
                                      .watches = caller.watches,
                                      .is_you = caller.address == AddressOf(you.peer()) &&
                                                caller.identity.name == you.caller().name});
        }
        for (const Activity::Change& change : activity.changes()) {
          *response->add_changes() =
              ToProto(LastChange{change.what, change.by, SecondsSince(change.time_ns, now_ns)});
        }
      });
}

}  // namespace palpate
