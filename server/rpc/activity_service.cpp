#include "server/rpc/activity_service.h"

#include "server/log/line_budget.h"
#include "server/realtime/tick_timer.h"
#include "server/rpc/activity.h"
#include "server/rpc/device_messages.h"

namespace palpate {
namespace {

double SecondsSince(std::int64_t time_ns, std::int64_t now_ns) {
  return 1e-9 * static_cast<double>(now_ns - time_ns);
}

}  // namespace

Reply* ActivityService::GetActivity(CallContext* context, const v1::GetActivityRequest* request,
                                    v1::GetActivityResponse* response) {
  return calls_.Answer(context, "/palpate.v1.ActivityService/GetActivity", *request, *response,
                       [=, this](const Admission& you) {
                         const Activity& activity = calls_.access().activity();
                         const std::int64_t now_ns = MonotonicNowNs();
                         for (const Activity::Caller& caller : activity.callers(now_ns)) {
                           v1::ConnectedCaller* out = response->add_callers();
                           *out->mutable_caller() = ToProto(caller.identity);
                           out->set_peer(PeerInWords(caller.address));
                           out->set_connected_s(SecondsSince(caller.came_ns, now_ns));
                           out->set_watches(caller.watches);
                           out->set_is_you(caller.address == AddressOf(you.peer()) &&
                                           caller.identity.name == you.caller().name);
                         }
                         for (const Activity::Change& change : activity.changes()) {
                           v1::LastChange* out = response->add_changes();
                           out->set_what(change.what);
                           out->set_by(change.by);
                           out->set_ago_s(SecondsSince(change.time_ns, now_ns));
                         }
                       });
}

}  // namespace palpate
