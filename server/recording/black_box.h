// Keeps the last ticks in memory. When a fault or the emergency stop cuts off forces, writes these
// ticks to a file, so that the cause can be found.
//
// The files are tables as in csv_export.h: FOLDER/fault-TIME-REASON.csv, and
// FOLDER/stop-TIME-REASON.csv for the emergency stop. TIME is UTC. REASON is the reason in the
// forces' state, or "input" if it has none. Of each kind, the newest kMostFiles files are kept. If
// the same reason comes again within kPauseS, the black box reports it but writes no file.
//
// Threads: OnSample on the pump thread. A fault costs the pump a copy of the ticks, but never a
// wait for the disk. A thread of its own writes files and calls `report`. Stop writes the waiting
// files.
#pragma once

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/pump/pump.h"

namespace palpate {

class BlackBox final : public SampleSink {
 public:
  static constexpr std::size_t kTicks = 2000;
  static constexpr double kPauseS = 5.0;
  static constexpr std::size_t kMostFiles = 20;

  // One line for the log. is_error: the file could not be written.
  using Report = std::function<void(const std::string& text, bool is_error)>;

  // The folder is made when the first file is written. If `folder` is empty, nothing is written.
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

  // Used only by the pump thread.
  std::vector<TickSample> ring_;
  std::uint64_t samples_ = 0;
  bool was_cut_ = true;  // starts true: before the first tick there is nothing to write
  std::string last_reason_;
  std::int64_t last_dump_ns_ = 0;

  std::mutex mutex_;  // guards the members below
  std::condition_variable due_;
  std::vector<Cut> waiting_;  // at most kMostWaiting
  std::string skipped_;       // reason of a cut that got no file; empty: none to report
  bool has_skipped_ = false;  // a cut since the last file got no file
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
