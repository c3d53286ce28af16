#include "client/cli/edit_result.h"

#include <fmt/core.h>

#include <cstdio>
#include <cstring>
#include <memory>

#include "client/cli/description.h"
#include "client/cli/output.h"
#include "common/error/error.h"
#include "common/wire/limits.h"

namespace palpate::cli {

void PrintEdit(const client::EditResult& result, bool json) {
  WriteOutput(json ? ToText(ToJson(result)) : DescribeEdit(result) + "\n");
}

std::string DescribeEdit(const client::EditResult& result) {
  std::string what = "no voxel changed";
  if (result.changed) {
    const client::IndexBox& box = *result.changed;
    what = fmt::format("{} voxel{} changed within {} {} {} to {} {} {}", result.changed_voxels,
                       result.changed_voxels == 1 ? "" : "s", box.min.x(), box.min.y(), box.min.z(),
                       box.max.x(), box.max.y(), box.max.z());
  }
  return fmt::format("{}, applied at tick {}, volume revision {}; {} to undo, {} to redo", what,
                     result.applied_tick, result.volume_revision, result.undo_steps,
                     result.redo_steps);
}

std::vector<float> ReadBlockValues(const std::string& file) {
  const auto close = [](std::FILE* f) {
    if (f != stdin) std::fclose(f);
  };
  const std::unique_ptr<std::FILE, decltype(close)> in(
      file == "-" ? stdin : std::fopen(file.c_str(), "rb"), close);
  if (!in) throw Error(ErrorKind::kNotFound, file + ": there is no such file that can be read");
  const std::string name = file == "-" ? "stdin" : file;
  std::string bytes(kMostBlockBytes + 1, '\0');
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), in.get()));
  if (std::ferror(in.get())) throw Error(ErrorKind::kInvalidArgument, name + ": cannot be read");
  if (bytes.size() > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge,
                name + ": a block has at most 3 MiB of values: send it in parts");
  }
  std::vector<float> values(bytes.size() / sizeof(float));
  if (values.size() * sizeof(float) != bytes.size()) {
    throw Error(ErrorKind::kInvalidArgument, name + ": its bytes are no whole number of float32");
  }
  std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

}  // namespace palpate::cli
