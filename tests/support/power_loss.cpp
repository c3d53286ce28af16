// Preloaded into a program, keeps what a loss of power would leave of its files: in the folder
// $PALPATE_DISK, of what lies in the folder $PALPATE_WATCHED. The bytes of a file are kept when it
// is synced, its name when its folder is; a name without such bytes has an empty file.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <set>
#include <string>

namespace {

namespace fs = std::filesystem;

std::mutex g_mutex;

fs::path Folder(const char* variable) {
  const char* folder = std::getenv(variable);
  return folder ? folder : "";
}

fs::path BytesOf(const struct stat& file) {
  return Folder("PALPATE_DISK") / "bytes" / std::to_string(file.st_ino);
}

void KeepBytes(const fs::path& descriptor, const struct stat& file) {
  const int from = open(descriptor.c_str(), O_RDONLY | O_CLOEXEC);
  // In place, as names of it may be kept already.
  const int to = open(BytesOf(file).c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  char buffer[1 << 16];
  for (ssize_t count = 0; (count = read(from, buffer, sizeof(buffer))) > 0;) {
    if (write(to, buffer, static_cast<std::size_t>(count)) != count) std::abort();
  }
  close(from);
  close(to);
}

void KeepNames(const fs::path& folder) {
  const fs::path relative = folder.lexically_relative(Folder("PALPATE_WATCHED"));
  const fs::path kept = (Folder("PALPATE_DISK") / "names" / relative).lexically_normal();
  // Its own name never reached the disk.
  if (!fs::is_directory(kept)) return;
  std::set<fs::path> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const fs::path name = entry.path().filename();
    struct stat file {};
    if (lstat(entry.path().c_str(), &file) != 0) continue;
    names.insert(name);
    if (S_ISDIR(file.st_mode)) {
      fs::create_directory(kept / name);
    } else if (S_ISREG(file.st_mode)) {
      close(open(BytesOf(file).c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
      fs::remove(kept / name);
      fs::create_hard_link(BytesOf(file), kept / name);
    }
  }
  for (const auto& entry : fs::directory_iterator(kept)) {
    if (!names.contains(entry.path().filename())) fs::remove_all(entry.path());
  }
}

void Keep(int descriptor) {
  const std::scoped_lock lock(g_mutex);
  const fs::path link = "/proc/self/fd/" + std::to_string(descriptor);
  std::error_code error;
  const fs::path path = fs::read_symlink(link, error);
  const std::string watched = Folder("PALPATE_WATCHED");
  struct stat status {};
  if (error || watched.empty() || !path.string().starts_with(watched)) return;
  if (fstat(descriptor, &status) != 0) return;
  if (S_ISREG(status.st_mode)) KeepBytes(link, status);
  if (S_ISDIR(status.st_mode)) KeepNames(path);
}

int Call(const char* name, int descriptor) {
  using Function = int (*)(int);
  const int result = reinterpret_cast<Function>(dlsym(RTLD_NEXT, name))(descriptor);
  if (result == 0) Keep(descriptor);
  return result;
}

}  // namespace

extern "C" int fsync(int descriptor) { return Call("fsync", descriptor); }
extern "C" int fdatasync(int descriptor) { return Call("fdatasync", descriptor); }
