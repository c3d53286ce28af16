#include "server/rpc/read_counter.h"

#include <google/protobuf/message.h>
#include <grpcpp/server_context.h>

#include <memory>

namespace palpate {
namespace {

using grpc::experimental::InterceptionHookPoints;

class ReadCounter final : public grpc::experimental::Interceptor {
 public:
  ReadCounter(const ConnectionWatch& watch, grpc::ServerContextBase& context)
      : watch_(watch), context_(context) {}

  void Intercept(grpc::experimental::InterceptorBatchMethods* batch) override {
    if (!is_begun_) Begin();
    if (counts_) Count(*batch);
    batch->Proceed();
  }

 private:
  // With the first batch: when this is made, the context does not know its peer yet.
  void Begin() {
    is_begun_ = true;
    counts_ = watch_.CountsOf(context_.peer());
    if (counts_) ++counts_->calls;
  }

  void Count(grpc::experimental::InterceptorBatchMethods& batch) {
    if (batch.QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_MESSAGE)) {
      ++counts_->answers;
    }
    if (!batch.QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE)) return;
    // None at the end of a client's stream.
    const auto* message = static_cast<const google::protobuf::Message*>(batch.GetRecvMessage());
    if (!message) return;
    ++counts_->messages;
    counts_->message_bytes += static_cast<std::int64_t>(message->ByteSizeLong());
  }

  const ConnectionWatch& watch_;
  grpc::ServerContextBase& context_;
  bool is_begun_ = false;
  std::shared_ptr<ReadCounts> counts_;
};

}  // namespace

grpc::experimental::Interceptor* ReadCounterFactory::CreateServerInterceptor(
    grpc::experimental::ServerRpcInfo* info) {
  return new ReadCounter(watch_, *info->server_context());
}

}  // namespace palpate
