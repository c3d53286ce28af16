#include "server/volume/whole_file.h"

#include <cstdio>
#include <ios>

#include "common/error/error.h"

namespace palpate {

void WriteWhole(const std::filesystem::path& path,
                const std::function<void(const std::filesystem::path& partial)>& write) {
  const std::filesystem::path partial = path.string() + ".partial";
  try {
    write(partial);
    std::filesystem::rename(partial, path);
  } catch (const std::ios_base::failure&) {
    std::remove(partial.c_str());
    throw Error(ErrorKind::kUnavailable, "cannot write " + path.string() +
                                             "; is there space, and may this user write there?");
  } catch (const std::filesystem::filesystem_error& error) {
    std::remove(partial.c_str());
    throw Error(ErrorKind::kUnavailable,
                "cannot write " + path.string() + ": " + error.code().message());
  }
}

}  // namespace palpate
