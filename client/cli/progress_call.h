// Calls whose answers are progress and, at the end, one result.
//
// Threads: main only.
#pragma once

#include <optional>
#include <string>
#include <type_traits>
#include <utility>

#include "client/cli/cancellable_call.h"
#include "client/cli/connection.h"
#include "client/cli/progress.h"
#include "client/interrupt/interrupt.h"

namespace palpate::cli {

// Runs such a call to its end and shows its progress; Ctrl-C and SIGTERM cancel it.
// `prepare(context, queue)`: such as a stub's PrepareAsyncLoadVolume. Response: a
// oneof of `progress` and `result`. `cancelled`: what to say then.
// Errors: as Connection::ErrorOf; kCancelled.
template <class Response, class Prepare>
auto RunWithProgress(const Connection& connection, const Prepare& prepare,
                     const std::string& cancelled) {
  const Interrupt interrupt;
  ProgressPrinter printer;
  StreamCall<Response> call(prepare);
  std::optional<std::decay_t<decltype(std::declval<Response>().result())>> result;
  Response response;
  while (call.Read(response)) {
    if (response.has_progress()) {
      printer.Print(response.progress().stage(), response.progress().fraction());
    } else if (response.has_result()) {
      result = response.result();
    }
  }
  const grpc::Status status = call.Finish();
  if (status.ok() && !result) {
    throw Error(ErrorKind::kInternal, "palpated ended the call without a result");
  }
  if (!status.ok() && Interrupt::IsRaised()) {
    throw Error(ErrorKind::kCancelled, cancelled);
  }
  if (!status.ok()) {
    throw connection.ErrorOfEnd(status);
  }
  return *result;
}

}  // namespace palpate::cli
