// What a viewer waits for, over gRPC on a Unix socket: a copy of a whole volume,
// and a brush of 16³ voxels from its publication to the `complete` of the copy.
#include <benchmark/benchmark.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "client/sdk/volume_mirror.h"
#include "client/sdk/volume_reader.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using testing::EditableSession;

struct Bench {
  explicit Bench(const std::string& source) {
    server.Reserve();
    data.Load(source);
    server.Start();
    channel = grpc::CreateChannel("unix:" + socket, grpc::InsecureChannelCredentials());
  }

  test::TemporaryFolder folder;
  std::string socket = folder.path() / "s";
  testing::ServedSession served{socket};
  EditableSession& data = served.data();
  RpcServer& server = served.server();
  std::shared_ptr<grpc::Channel> channel;
};

void CompleteAt(client::VolumeReader& reader, const client::VolumeMirror& mirror,
                std::uint64_t revision) {
  while (!mirror.is_complete() || mirror.resume()->volume_revision != revision) reader.Next(1s);
}

void FreshCopy(benchmark::State& state, const std::string& source) {
  Bench bench(source);
  std::uint64_t bytes = 0;
  for (auto _ : state) {
    client::VolumeMirror mirror;
    client::VolumeReader reader(bench.channel, mirror);
    CompleteAt(reader, mirror, 1);
    bytes = reader.bytes_received();
  }
  state.counters["MB_on_the_wire"] = static_cast<double>(bytes) * 1e-6;
}

void Brush(benchmark::State& state) {
  Bench bench("builtin:gyroid:256");
  client::VolumeMirror mirror;
  client::VolumeReader reader(bench.channel, mirror);
  CompleteAt(reader, mirror, 1);
  std::mt19937 random(1);
  std::vector<double> times_us;
  for (auto _ : state) {
    const Vec3i from(random() % 240, random() % 240, random() % 240);
    const auto changes =
        testing::PaintedBox(bench.data.volume()->bricks(), from, from + Vec3i::Constant(16),
                            [&] { return static_cast<float>(random() % 1000) * 1e-3f; });
    const auto begin = std::chrono::steady_clock::now();
    const std::uint64_t revision =
        bench.data.session().store().Edit([&](const auto&) { return changes; }).volume;
    CompleteAt(reader, mirror, revision);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    state.SetIterationTime(took.count());
    times_us.push_back(took.count() * 1e6);
  }
  std::sort(times_us.begin(), times_us.end());
  state.counters["median_us"] = times_us[times_us.size() / 2];
  state.counters["p95_us"] = times_us[times_us.size() * 95 / 100];
}

BENCHMARK_CAPTURE(FreshCopy, gyroid_256, "builtin:gyroid:256")
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(FreshCopy, bumps_256, "builtin:bumps:256")
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(Brush)->UseManualTime()->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate

BENCHMARK_MAIN();
