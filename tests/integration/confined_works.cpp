// What readers must go on doing in confinement; see confined_child.cpp.
#include <limits.h>
#include <pthread.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>

#include "tests/integration/confined_child.h"

namespace palpate {

void Check(bool done, const char* what) {
  if (!done) throw std::runtime_error(std::string(what) + ": " + std::strerror(errno));
}

namespace {

namespace fs = std::filesystem;

// As many as a hostile importer would start, with the smallest stacks.
void StartManyThreads() {
  constexpr int kFarTooMany = 8000;
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, PTHREAD_STACK_MIN);
  const auto sleep = [](void*) -> void* {
    std::this_thread::sleep_for(std::chrono::seconds(100));
    return nullptr;
  };
  for (int n = 0; n < kFarTooMany; ++n) {
    pthread_t thread;
    errno = pthread_create(&thread, &attributes, sleep, nullptr);
    if (errno == 0) continue;
    Check(errno == EAGAIN && n > 16, "start threads");
    return;
  }
  throw std::runtime_error("nothing limits the threads");
}

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

// The reporter's handlers end the next three with its message.
void Crash() { std::abort(); }
void CrashInAThread() { std::thread(Crash).join(); }
void RunOutOfTime() { std::this_thread::sleep_for(std::chrono::hours(24)); }

const Work kWorks[] = {
    {"read_files", ReadFiles},
    {"write_memory_file", WriteMemoryFile},
    {"crash", Crash},
    {"crash_in_a_thread", CrashInAThread},
    {kTimeout.data(), RunOutOfTime},
    {kManyThreads.data(), StartManyThreads},
};

}  // namespace

std::span<const Work> Works() { return kWorks; }

}  // namespace palpate
