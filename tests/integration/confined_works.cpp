// What readers must go on doing in confinement; see confined_child.cpp.
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/import/file_start.h"
#include "tests/integration/confined_child.h"

namespace palpate {

void Check(bool done, const char* what) {
  if (!done) throw std::runtime_error(std::string(what) + ": " + std::strerror(errno));
}

namespace {

namespace fs = std::filesystem;

void ReadFiles() {
  std::ifstream in(readable_file);
  std::string text;
  Check(std::getline(in, text) && text == "readable", "read");
  Check(access(readable_file.c_str(), R_OK) == 0, "access");
  int count = 0;
  for (const auto& entry : fs::directory_iterator(fs::path(readable_file).parent_path())) {
    count += entry.is_regular_file();
  }
  Check(count > 0, "list");
  Check(fs::weakly_canonical(readable_file) == readable_file, "weakly_canonical");
  const int file = Open(readable_file, O_RDONLY);
  Check(mmap(nullptr, 1, PROT_READ, MAP_PRIVATE, file, 0) != MAP_FAILED, "map");
  close(file);
}

void ReadFileStart() {
  for (const std::string expected : {"read", "readable"}) {
    const FileStart start(readable_file, static_cast<std::int64_t>(expected.size()));
    std::ifstream in(start.path());
    std::string text;
    Check(std::getline(in, text).eof() && text == expected, "read the start");
  }
}

void WriteMemoryFile() {
  constexpr int kSize = 1 << 20;
  Check(ftruncate(memory_file, kSize) == 0, "ftruncate");
  Check(fallocate(memory_file, 0, 0, 2 * kSize) == 0, "fallocate");
  Check(write(memory_file, "a", 1) == 1, "write");
  Check(pwrite(memory_file, "b", 1, kSize) == 1, "pwrite");
  Check(lseek(memory_file, 0, SEEK_END) == 2 * kSize, "lseek");
  auto* const map =
      static_cast<char*>(mmap(nullptr, kSize, PROT_READ | PROT_WRITE, MAP_SHARED, memory_file, 0));
  Check(map != MAP_FAILED && map[0] == 'a', "mmap");
  map[1] = 'c';
  Check(msync(map, kSize, MS_SYNC) == 0 && munmap(map, kSize) == 0, "munmap");
  Check(fsync(memory_file) == 0, "fsync");
  Check(fcntl(memory_file, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE) == 0, "seal");
  Check(write(memory_file, "a", 1) < 0, "be sealed");
}

void WritePipe() {
  iovec part{bytes, 1};
  Check(write(pipe_to_write, bytes, 1) == 1 && writev(pipe_to_write, &part, 1) == 1, "write");
}

void StartThreads() {
  int sum = 0;
  for (int k = 0; k < 3; ++k) {
    std::thread([&sum, k] {
      prctl(PR_SET_NAME, "reader");
      std::vector<int> numbers(1000, k);
      sum += numbers[999];
      try {
        throw std::runtime_error("in a thread");
      } catch (const std::exception&) {
        ++sum;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }).join();
  }
  Check(sum == 6, "add");
}

void AllocateMemory() {
  std::vector<char> large(std::size_t{64} << 20, 'x');
  large.resize(std::size_t{80} << 20);
  Check(large[1] == 'x', "remember");
  std::vector<char>().swap(large);
  for (int k = 1; k < 200; ++k) {
    free(realloc(malloc(static_cast<std::size_t>(k) * 1000), static_cast<std::size_t>(k) * 9000));
  }
}

void ThrowAndCatch() {
  try {
    throw Error(ErrorKind::kTooLarge, "thrown");
  } catch (const Error& error) {
    Check(error.kind() == ErrorKind::kTooLarge, "catch");
  }
}

void AskTheTime() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::time_t seconds = std::chrono::duration_cast<std::chrono::seconds>(now).count();
  Check(std::localtime(&seconds) != nullptr, "localtime");
  Check(std::thread::hardware_concurrency() > 0, "count processors");
}

// The reporter's handlers end the next three with its message.
void Crash() { std::abort(); }
void CrashInAThread() { std::thread(Crash).join(); }
void RunOutOfTime() { std::this_thread::sleep_for(std::chrono::seconds(20)); }

const Work kWorks[] = {
    {"read_files", ReadFiles},
    {"read_file_start", ReadFileStart},
    {"write_memory_file", WriteMemoryFile},
    {"write_pipe", WritePipe},
    {"start_threads", StartThreads},
    {"allocate_memory", AllocateMemory},
    {"throw_and_catch", ThrowAndCatch},
    {"ask_the_time", AskTheTime},
    {"crash", Crash},
    {"crash_in_a_thread", CrashInAThread},
    {kTimeout.data(), RunOutOfTime},
};

}  // namespace

std::span<const Work> Works() { return kWorks; }

}  // namespace palpate
