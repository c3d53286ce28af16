// Keeps the last ticks, and writes them to a file when forces are cut off by a fault
// or the emergency stop, so that what led there can be looked at.
//
// Files are tables as of csv_export.h: FOLDER/fault-TIME-REASON.csv, and stop-TIME-...
// for the emergency stop, UTC. REASON is that of the forces' state; "buried" where the surface was
// moved over the stylus and it did not come out. The newest kMostFiles of either are kept. The same
// reason again within kPauseS is only reported.
//
// Threads: OnSample on the pump thread, which it costs a copy of the ticks at a fault
// and never the disk; files are written on a thread of its own; `report` is called
// there. Stop writes what is due.
#pragma once

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/samples/pump.h"

namespace palpate {

class BlackBox final : public SampleSink {
 public:
  static constexpr std::size_t kTicks = 2000;
  static constexpr double kPauseS = 5.0;
  static constexpr std::size_t kMostFiles = 20;

  // A line for the log; is_error: nothing could be written.
  using Report = std::function<void(const std::string& text, bool is_error)>;

  // The folder is made when it is needed; empty: nothing is written.
  BlackBox(std::filesystem::path folder, Report report);
  ~BlackBox() override { Stop(); }

  void Start();
  void Stop() noexcept;

  void OnSample(const TickSample& sample) override;

 private:
  struct Cut {
    std::vector<TickSample> ticks;
    std::string reason;
  };

  // Oldest first.
  std::vector<TickSample> Ticks() const;
  void Run();
  void Write(const Cut& cut) const;

  const std::filesystem::path folder_;
  const Report report_;

  // The pump thread's.
  std::vector<TickSample> ring_;
  std::uint64_t samples_ = 0;
  std::uint64_t faulty_ticks_ = 0;
  bool was_cut_ = true;  // nothing led to a fault in the first tick
  std::string last_reason_;
  std::int64_t last_dump_ns_ = 0;

  std::mutex mutex_;  // guards what follows
  std::condition_variable due_;
  std::vector<Cut> waiting_;  // a few
  std::string skipped_;       // reason of a cut without a file
  bool has_skipped_ = false;  // since the last file
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
