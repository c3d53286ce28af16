#include "server/volume/load/import_process.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <utility>

#include "common/error/error.h"
#include "common/files/descriptor.h"
#include "server/volume/load/handover.h"
#include "server/volume/load/importer.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

// The importer ends itself at its timeout. If it does not, it is killed this much later.
constexpr auto kTimeoutGrace = std::chrono::seconds(2);
// The importer's share of the progress. The rest is for taking over the volume.
constexpr double kImporterShare = 0.9;

std::string Decimal(double value) {
  std::array<char, 32> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

void AddRawArguments(const RawVoxels& raw, std::vector<std::string>* arguments) {
  arguments->push_back("--raw-size=" + std::to_string(raw.size[0]) + "," +
                       std::to_string(raw.size[1]) + "," + std::to_string(raw.size[2]));
  arguments->push_back("--raw-type=" + raw.type);
  arguments->push_back("--raw-offset=" + std::to_string(raw.offset_bytes));
  if (raw.big_endian) arguments->push_back("--raw-big-endian");
}

std::vector<std::string> Arguments(const ImportRequest& request) {
  std::vector<std::string> arguments = {
      request.import_program.string(),
      "--progress",
      "--to-descriptor=" + std::to_string(kChildDescriptor),
      "--max-voxels=" + std::to_string(request.max_voxels),
      "--max-memory-mib=" +
          std::to_string(std::max<std::int64_t>(request.max_memory_bytes >> 20, 1)),
      "--timeout-s=" + std::to_string(std::max<std::int64_t>(request.timeout.count(), 1)),
  };
  if (request.folders) {
    // Also passed if the list of folders is empty: then the importer may read only files beside the
    // source.
    arguments.push_back("--only-below=" + request.source.string());
    for (const auto& folder : *request.folders) {
      arguments.push_back("--only-below=" + folder.string());
    }
  }
  for (const auto& path : request.own_files.paths()) {
    arguments.push_back("--never=" + path.string());
  }
  if (request.spacing_mm) {
    const Vec3& s = *request.spacing_mm;
    arguments.push_back("--spacing-mm=" + Decimal(s.x()) + "," + Decimal(s.y()) + "," +
                        Decimal(s.z()));
  }
  if (request.frame) arguments.push_back("--frame=" + std::to_string(*request.frame));
  if (request.raw) AddRawArguments(*request.raw, &arguments);
  if (!request.grid.empty()) arguments.push_back("--grid=" + request.grid);
  if (!request.component.empty()) arguments.push_back("--component=" + request.component);
  // "--", because a path may start with a dash.
  arguments.insert(arguments.end(), {"--", request.source.string()});
  return arguments;
}

// Parses "size X Y Z BYTES": the volume's size, and the bytes of a voxel in the file. A stack of
// slices tells growing sizes. A smaller one than before would take back what was claimed.
void ReportSize(std::string_view line, const SizeKnown& on_size, std::uint64_t& told_bytes) {
  constexpr std::string_view kWord = "size";
  if (!on_size || !line.starts_with(kWord)) return;
  line.remove_prefix(kWord.size());
  std::array<int, 4> numbers{};
  for (int& number : numbers) {
    if (!line.starts_with(' ')) return;
    const auto [end, error] = std::from_chars(line.data() + 1, line.data() + line.size(), number);
    if (error != std::errc() || number < 1) return;
    line.remove_prefix(static_cast<std::size_t>(end - line.data()));
  }
  if (!line.empty()) return;
  const auto [x, y, z, bytes] = numbers;
  std::int64_t voxels = 0;
  if (__builtin_mul_overflow(std::int64_t{x} * y, z, &voxels) || voxels > kMostLatticeVoxels) {
    throw Error(ErrorKind::kTooLarge, "the importer names a size that no volume has");
  }
  const LeafType type = bytes == 1   ? LeafType::kUint8
                        : bytes == 2 ? LeafType::kInt16
                                     : LeafType::kFloat;
  const LoadMemory memory = DenseLoadMemory({x, y, z}, type);
  if (memory.Sum() < told_bytes) return;
  told_bytes = memory.Sum();
  on_size({x, y, z}, memory);
}

[[noreturn]] void ThrowCancelled(const ImportRequest& request) {
  throw Error(ErrorKind::kCancelled, request.source.string() + ": the import was cancelled");
}

ChildEnd RunImporter(const ImportRequest& request, int handover,
                     const std::function<void(std::string_view, double)>& progress,
                     const std::function<bool()>& cancelled) {
  const auto deadline = Clock::now() + request.timeout + kTimeoutGrace;
  std::uint64_t told_bytes = 0;
  const auto on_line = [&](std::string_view line) {
    double fraction = 0.0;
    std::string_view stage;
    if (progress && ParseProgress(line, fraction, stage)) {
      progress(stage, fraction * kImporterShare);
    }
    ReportSize(line, request.on_size, told_bytes);
  };
  const auto check = [&] {
    if (cancelled && cancelled()) ThrowCancelled(request);
    if (Clock::now() > deadline) {
      throw Error(ErrorKind::kTooLarge, request.source.string() + ": the import took longer than " +
                                            std::to_string(request.timeout.count()) +
                                            " s; crop the volume or raise the limit");
    }
  };
  return RunChild({.arguments = Arguments(request),
                   .descriptor = handover,
                   .on_line = on_line,
                   .check = check});
}

}  // namespace

LoadedVolume ImportVolume(const ImportRequest& request,
                          const std::function<void(std::string_view, double)>& progress,
                          const std::function<bool()>& cancelled,
                          std::vector<std::string>* warnings) {
  const Descriptor handover = MakeHandoverFile();
  const ChildEnd end = RunImporter(request, handover.get(), progress, cancelled);
  // The importer's own line names the format, unless it crashed too badly to write it.
  ThrowUnlessSuccess(end, request.source.string(),
                     "the import ran out of memory, time or disk; crop the volume",
                     "the reader of this format crashed, which is a fault of the reader: save the "
                     "volume in another format");
  if (warnings) {
    warnings->insert(warnings->end(), end.warnings.begin(), end.warnings.end());
  }
  const auto tell = [&](double fraction) {
    if (cancelled && cancelled()) ThrowCancelled(request);
    if (progress) progress("loading", kImporterShare + (1.0 - kImporterShare) * fraction);
  };
  bool is_telling = false;  // during a listener's call; its exceptions name the file themselves
  const auto on_size = [&](const Vec3i& size, const LoadMemory& memory) {
    is_telling = true;
    if (request.on_size) request.on_size(size, memory);
    is_telling = false;
  };
  const auto on_progress = [&](double fraction) {
    is_telling = true;
    tell(fraction);
    is_telling = false;
  };
  try {
    LoadedVolume volume = TakeHandover(
        handover.get(),
        {.max_voxels = request.max_voxels, .on_size = on_size, .progress = on_progress});
    tell(1.0);
    return volume;
  } catch (const Error& error) {
    if (is_telling) throw;
    throw Error(error.kind(), request.source.string() + ": " + error.what());
  } catch (const std::bad_alloc&) {
    throw Error(ErrorKind::kTooLarge,
                request.source.string() + ": there is not enough memory to hold it");
  }
}

}  // namespace palpate
