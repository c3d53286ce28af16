// recording_child PATH [overwrite]: records to PATH until it is killed, and says
// how many ticks are on the disk; "under way" from 1000 on.
#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>

#include "server/recording/recorder.h"
#include "tests/support/recording.h"

int main(int count, char** arguments) {
  using namespace palpate;
  if (count < 2) return kUsageExitCode;
  try {
    Recorder recorder(CreateRecordingFile(arguments[1], count > 2), "recording_child");
    for (std::uint64_t tick = 0;; ++tick) {
      recorder.OnSample(testing::RandomSample(tick));
      if (tick % 50 != 0) continue;
      const std::uint64_t ticks = recorder.report().counts.ticks;
      std::printf("%sticks %llu\n", ticks >= 1000 ? "under way: " : "",
                  static_cast<unsigned long long>(ticks));
      std::fflush(stdout);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  } catch (const Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return ExitCode(error.kind());
  }
}
