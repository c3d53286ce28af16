// Answers calls: judges who calls, does the work on a thread of its own, and gives the answer to
// gRPC, which sends it when the client reads it.
//
// A service's method returns Answer for one answer, Stream for several:
//   return calls_.Answer(context, "/palpate.v1.XService/Y", *request, *response,
//                        [=, this](const Admission&) { *response = ...; });
// The work runs on a thread of the entrance by which the call came. It throws to fail;
// common/wire/status.h makes the status.
//
// Threads: any. Ownership: a call owns itself until gRPC has finished with it.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/grpcpp.h>

#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/wire/status.h"
#include "server/door/access.h"
#include "server/door/entrance.h"
#include "server/security/methods.h"
#include "server/session/session.h"

namespace palpate {

using CallContext = grpc::CallbackServerContext;
using Reply = grpc::ServerUnaryReactor;  // answers one request once

// Sends the events of one call in their order. Does not wait for the client: of the events that
// wait for it, the newest replaces the one before if there are too many.
template <class Event>
class EventStream final : public grpc::ServerWriteReactor<Event> {
 public:
  static constexpr std::size_t kMostWaiting = 64;

  explicit EventStream(Admission admission) : admission_(std::move(admission)) {}

  const Admission& admission() const { return admission_; }

  void Send(Event event) {
    const std::lock_guard lock(mutex_);
    if (waiting_.size() >= kMostWaiting) waiting_.pop_back();
    waiting_.push_back(std::move(event));
    if (waiting_.size() == 1) this->StartWrite(&waiting_.front());
  }
  // Call it once, after the last event. This object may be gone afterwards.
  void End(const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    std::size_t bytes = 0;
    for (const Event& event : waiting_) bytes += event.ByteSizeLong();
    admission_.Answered(status, bytes);  // what was sent stays sent
    end_ = status;
    if (waiting_.empty()) this->Finish(*end_);
  }

  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    if (ok) {
      waiting_.pop_front();
    } else {
      waiting_.clear();
    }
    if (!waiting_.empty()) {
      this->StartWrite(&waiting_.front());
    } else if (end_) {
      this->Finish(*end_);
    }
  }
  void OnDone() override {
    { const std::lock_guard lock(mutex_); }  // End or OnWriteDone may still hold it
    delete this;
  }

 private:
  Admission admission_;
  std::mutex mutex_;
  // The first is being written; a deque, so that it stays where it is.
  std::deque<Event> waiting_;
  std::optional<grpc::Status> end_;
};

// Sends the progress of work as events.
template <class Event>
auto ProgressTo(EventStream<Event>& events) {
  return [&events](std::string_view stage, double fraction) {
    Event event;
    event.mutable_progress()->set_stage(std::string(stage));
    event.mutable_progress()->set_fraction(fraction);
    events.Send(std::move(event));
  };
}

class Calls {
 public:
  using Cancelled = std::function<bool()>;

  // Borrows both.
  Calls(Access& access, Session& session) : access_(access), session_(session) {}

  Access& access() { return access_; }

  // Throws Error if the method's rule does not let it act now: kLoading before the first volume,
  // kConflict during a replay.
  void RequireNow(std::string_view method) const {
    const MethodRule& rule = *FindMethodRule(method);
    if (rule.needs_volume) session_.first_load().Require();
    if (rule.in_replay == InReplay::kRefused) session_.RequireNoReplay();
  }

  // work: void(const Admission&)
  template <class Work>
  Reply* Answer(CallContext* context, std::string_view method,
                const google::protobuf::Message& request, const google::protobuf::Message& response,
                Work work) {
    auto* const call = new UnaryCall(access_.Admit(context, method, request.ByteSizeLong()));
    if (!call->admission.ok()) {
      call->Finish(call->admission.status());
      return call;
    }
    Entrance::Of(*context).threads().Run(
        method, [this, method, call, &response, work = std::move(work)] {
          grpc::Status status;
          {
            // Counted before the client can ask again.
            const Access::Work measured(access_, call->admission);
            status = StatusOf(call->admission, [&] {
              measured.Begin();
              RequireNow(method);
              work(std::as_const(call->admission));
            });
          }
          call->Finish(call->admission.Answered(status, response.ByteSizeLong()));
        });
    return call;
  }

  // work: void(EventStream<Event>&, const Cancelled&)
  template <class Event, class Work>
  EventStream<Event>* Stream(CallContext* context, std::string_view method, Work work) {
    auto* const stream = new EventStream<Event>(access_.Admit(context, method));
    if (!stream->admission().ok()) {
      stream->End(stream->admission().status());
      return stream;
    }
    Entrance::Of(*context).threads().Run(
        method, [this, method, context, stream, work = std::move(work)] {
          const Cancelled cancelled = [context] { return context->IsCancelled(); };
          stream->End(StatusOf(stream->admission(), [&] {
            RequireNow(method);
            work(*stream, cancelled);
          }));
        });
    return stream;
  }

 private:
  struct UnaryCall final : Reply {
    explicit UnaryCall(Admission admitted) : admission(std::move(admitted)) {}
    void OnDone() override { delete this; }
    Admission admission;
  };

  template <class Work>
  static grpc::Status StatusOf(const Admission& admission, const Work& work) {
    try {
      work();
      return grpc::Status::OK;
    } catch (const std::exception& error) {
      return admission.Failed(error);
    }
  }

  Access& access_;
  Session& session_;
};

}  // namespace palpate
