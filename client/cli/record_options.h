// The options of `palpate record`, `palpate mark` and `palpate replay`.
//
// Threads: main only.
#pragma once

#include <string>

#include "client/cli/invocation.h"
#include "client/cli/record_command.h"

namespace palpate::cli {

// Where the options put their values.
struct RecordValues {
  RecordOptions record;
  std::string marker;
  ReplayOptions replay;
};

void AddRecord(arguments::Command& app, Invocation& invocation, RecordValues& values);
void AddMark(arguments::Command& app, Invocation& invocation, RecordValues& values);
void AddReplay(arguments::Command& app, Invocation& invocation, RecordValues& values);

}  // namespace palpate::cli
