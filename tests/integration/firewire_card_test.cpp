// The emulated FireWire bus by itself, by plain system calls: whether it speaks the kernel's
// linux/firewire-cdev.h, and what its Omni does.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/firewire-cdev.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>

#include "tests/support/firewire_testbed.h"
#include "tests/support/omni_firewire_emulator.h"
#include "tests/support/patience.h"

namespace palpate::test {
namespace {

constexpr std::uint8_t kSlotBytes = 72;
constexpr std::uint32_t kTypeError = RCODE_TYPE_ERROR, kOldGeneration = RCODE_GENERATION;
// Places of the events' fields.
constexpr std::size_t kType = 8, kRcode = 12, kLength = 16, kData = 20, kChannel = 16, kNew = 32;

std::uint32_t WordAt(const Bytes& bytes, std::size_t at) {
  std::uint32_t word = 0;
  if (at + 4 <= bytes.size()) std::memcpy(&word, bytes.data() + at, 4);
  return word;
}
std::uint32_t BigEndianAt(const Bytes& bytes, std::size_t at) {
  return __builtin_bswap32(WordAt(bytes, at));
}
std::uintptr_t Address(const void* there) { return reinterpret_cast<std::uintptr_t>(there); }

// A descriptor of a node.
class Descriptor {
 public:
  explicit Descriptor(const std::string& node) : fd_(open(node.c_str(), O_RDWR | O_CLOEXEC)) {
    fw_cdev_event_bus_reset bus{};
    fw_cdev_get_info info{.version = 5,
                          .rom_length = 0,
                          .rom = 0,
                          .bus_reset = Address(&bus),
                          .bus_reset_closure = 9,
                          .card = 1};
    EXPECT_EQ(Call(FW_CDEV_IOC_GET_INFO, info), 0);
    EXPECT_EQ(info.version, 5u);
    EXPECT_EQ(info.rom_length, 32u);
    generation = bus.generation;
  }
  ~Descriptor() { close(fd_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  std::uint32_t generation = 0;

  template <class T>
  int Call(unsigned long request, T&& argument) {
    return ioctl(fd_, request, &argument);
  }
  pollfd Poll() const { return {.fd = fd_, .events = POLLIN, .revents = 0}; }
  // None: errno says why.
  Bytes Read() {
    Bytes bytes(5000);
    const ssize_t count = read(fd_, bytes.data(), bytes.size());
    bytes.resize(count < 0 ? 0 : static_cast<std::size_t>(count));
    return bytes;
  }
  // Waits for the next event.
  Bytes Next() {
    Bytes event;
    EXPECT_TRUE(Eventually([&] {
      pollfd one = Poll();
      if (poll(&one, 1, 0) == 1) event = Read();
      return !event.empty();
    }));
    return event;
  }

  // Returns the rcode.
  std::uint32_t Request(std::uint32_t tcode, std::uint64_t address, Bytes& data) {
    EXPECT_EQ(Call(FW_CDEV_IOC_SEND_REQUEST,
                   fw_cdev_send_request{.tcode = tcode,
                                        .length = static_cast<std::uint32_t>(data.size()),
                                        .offset = address,
                                        .closure = 77,
                                        .data = Address(data.data()),
                                        .generation = generation}),
              0);
    const Bytes event = Next();
    EXPECT_EQ(WordAt(event, kType), FW_CDEV_EVENT_RESPONSE * 1u);
    EXPECT_EQ(WordAt(event, 0), 77u);
    std::copy_n(event.begin() + kData, WordAt(event, kLength), data.begin());
    return WordAt(event, kRcode);
  }
  std::uint32_t Write(std::uint64_t address, std::uint8_t byte) {
    Bytes data = {byte};
    return Request(TCODE_WRITE_BLOCK_REQUEST, address, data);
  }
  std::uint32_t AllocateChannel() {
    EXPECT_EQ(Call(FW_CDEV_IOC_ALLOCATE_ISO_RESOURCE,
                   fw_cdev_allocate_iso_resource{
                       .closure = 0, .channels = ~0ULL, .bandwidth = 816, .handle = 0}),
              0);
    const Bytes event = Next();
    EXPECT_EQ(WordAt(event, kType), FW_CDEV_EVENT_ISO_RESOURCE_ALLOCATED * 1u);
    return WordAt(event, kChannel);
  }
  int Create(std::uint32_t type, std::uint32_t channel) {
    return Call(FW_CDEV_IOC_CREATE_ISO_CONTEXT,
                fw_cdev_create_iso_context{.type = type,
                                           .header_size = kSlotBytes,
                                           .channel = channel,
                                           .speed = SCODE_100,
                                           .closure = 0,
                                           .handle = 0});
  }
  // Returns the number of packets.
  int Queue(const Bytes& packets) {
    return Call(FW_CDEV_IOC_QUEUE_ISO,
                fw_cdev_queue_iso{.packets = Address(packets.data()),
                                  .data = 0,
                                  .size = static_cast<std::uint32_t>(packets.size()),
                                  .handle = 0});
  }
  int QueueSlots(std::size_t count) {
    Bytes packets;
    while (count-- > 0) packets.insert(packets.end(), {0, 0, 1, kSlotBytes});
    return Queue(packets);
  }
  // The second motor at 257, others at 0.
  int QueueForce(bool enabled) {
    return Queue(
        {0,    0, 1, 16, 0xff, 7, 0, 9, 0xff, 7, static_cast<std::uint8_t>(enabled ? 0xcb : 0xc3),
         0x53, 0, 0, 0,  0,    0, 0, 0, 0});
  }
  int Start() {
    return Call(FW_CDEV_IOC_START_ISO,
                fw_cdev_start_iso{.cycle = -1, .sync = 0, .tags = 15, .handle = 0});
  }

 private:
  const int fd_;
};

class FirewireCardTest : public ::testing::Test {
 protected:
  OmniFirewireEmulator omni_;
  EmulatedFirewireDevice camera_{0x08004603'01234567};
  FirewireTestbed bus_;
};

TEST_F(FirewireCardTest, HasFoldersAndRegisters) {
  bus_.Plug(camera_);
  ASSERT_EQ(bus_.Plug(omni_, false), "/dev/fw2");
  EXPECT_EQ(access("/dev/fw2", R_OK | W_OK), -1);
  EXPECT_EQ(errno, EACCES);
  bus_.SetMayOpen(omni_, true);
  std::string guid;
  std::ifstream("/sys/bus/firewire/devices/fw2/guid") >> guid;
  EXPECT_EQ(guid, "0x000b990083a6d80e");

  Descriptor a("/dev/fw2");
  Bytes quadlet(4), byte(1);
  EXPECT_EQ(a.Request(TCODE_READ_QUADLET_REQUEST, 0x1006000c, quadlet), 0u);
  EXPECT_EQ(quadlet, (Bytes{0x00, 0x0b, 0x99, 0x00}));
  EXPECT_EQ(a.Request(TCODE_READ_BLOCK_REQUEST, 0x1083, byte), 0u);
  EXPECT_EQ(byte, Bytes{0xc0});
  EXPECT_EQ(a.Request(TCODE_READ_QUADLET_REQUEST, 0x1083, quadlet), kTypeError);
  omni_.AnswerNext(1, RCODE_BUSY);
  EXPECT_EQ(a.Write(0x1000, 3), RCODE_BUSY * 1u);
  EXPECT_FALSE(omni_.Register(0x1000));

  bus_.BusReset();
  const Bytes reset = a.Next();
  EXPECT_EQ(WordAt(reset, kType), FW_CDEV_EVENT_BUS_RESET * 1u);
  EXPECT_EQ(WordAt(reset, kNew), a.generation + 1);
  EXPECT_EQ(a.Write(0x1000, 3), kOldGeneration);
  a.generation = WordAt(reset, kNew);
  EXPECT_EQ(a.Write(0x1000, 3), 0u);
  EXPECT_TRUE(omni_.Mistakes().empty());
  // Neither poll nor another descriptor has said that there is an event.
  a.Read();
  EXPECT_EQ(errno, EAGAIN);
  EXPECT_EQ(omni_.Mistakes().size(), 1u);
  EXPECT_EQ(camera_.CountOf(FirewireEvent::Kind::kOpen), 0u);
}

TEST_F(FirewireCardTest, StreamsAndTakesForces) {
  const std::string node = bus_.Plug(omni_);
  omni_.SetHand({.encoders = {100, -200, 300}, .pressed = 2});
  bus_.SetFaults({.taken_channels = 1});
  Descriptor a(node), b(node);
  const std::uint32_t from = a.AllocateChannel(), to = a.AllocateChannel();
  EXPECT_EQ(from, 1u);
  ASSERT_EQ(a.Create(FW_CDEV_ISO_CONTEXT_RECEIVE, from), 0);
  ASSERT_EQ(b.Create(FW_CDEV_ISO_CONTEXT_TRANSMIT, to), 0);
  EXPECT_EQ(b.Create(FW_CDEV_ISO_CONTEXT_TRANSMIT, to), -1);
  EXPECT_EQ(errno, EBUSY);
  EXPECT_EQ(a.Start(), -1);
  EXPECT_EQ(errno, ENODATA);
  EXPECT_EQ(a.QueueSlots(512), 512);
  EXPECT_EQ(a.Start(), 0);
  for (int n = 0; n < 3; ++n) EXPECT_EQ(b.QueueForce(false), 1);
  EXPECT_EQ(a.Write(0x1000, static_cast<std::uint8_t>(to)), 0u);
  EXPECT_EQ(a.Write(0x1001, static_cast<std::uint8_t>(from)), 0u);
  EXPECT_EQ(a.Write(0x1087, 8), 0u);
  EXPECT_EQ(b.Start(), 0);

  std::size_t packets = 0, forces = 0;
  std::uint32_t cycle = 0;
  while (packets < 1000) {
    pollfd both[] = {a.Poll(), b.Poll()};
    ASSERT_GT(poll(both, 2, 10'000), 0);
    const Bytes received = a.Read(), sent = b.Read();
    const std::size_t count = received.empty() ? 0 : WordAt(received, kLength) / kSlotBytes;
    for (std::size_t n = 0; n < count; ++n) {
      const std::size_t at = kData + n * kSlotBytes;
      EXPECT_EQ(BigEndianAt(received, at), 44u << 16 | from << 8 | 0xa0);
      const std::uint32_t now = BigEndianAt(received, at + 4) & 0x1fff;
      EXPECT_TRUE(packets == 0 || (now + 8000 - cycle) % 8000 % 8 == 0);
      ++packets;
      cycle = now;
      EXPECT_EQ(WordAt(received, at + 8 + 4), 0xff380064u);  // -200 and 100
      EXPECT_EQ(received[at + 8 + 19], 0x05);
    }
    EXPECT_EQ(a.QueueSlots(count), static_cast<int>(count));
    if (sent.empty()) continue;
    const std::size_t taken = WordAt(sent, kLength) / 4;
    forces += taken;
    for (std::size_t n = 0; n < taken; ++n) EXPECT_EQ(b.QueueForce(forces > 10), 1);
  }
  const FirewireCounts counts = omni_.Counts();
  EXPECT_EQ(counts.unheard, 0u);
  EXPECT_GE(counts.delivered, packets);
  EXPECT_GE(omni_.Forces().size(), forces);
  EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{0, 257, 0}));
  EXPECT_TRUE(omni_.Mistakes().empty());

  // A bus reset ends the stream, and not the contexts. Unplugged, all calls fail.
  bus_.BusReset();
  EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{}));
  bus_.Unplug(omni_);
  EXPECT_TRUE(Eventually([&] { return a.Read().empty(); }));
  EXPECT_EQ(errno, ENODEV);
  EXPECT_EQ(b.QueueForce(true), -1);
  EXPECT_EQ(errno, ENODEV);
  EXPECT_NE(access("/sys/bus/firewire/devices/fw1/guid", F_OK), 0);
}

TEST_F(FirewireCardTest, HasFaults) {
  Descriptor a(bus_.Plug(omni_));
  bus_.SetFaults({.no_bandwidth = true});
  EXPECT_EQ(a.AllocateChannel(), static_cast<std::uint32_t>(-EBUSY));
  bus_.SetFaults({.loses_channels_at_reset = true});
  EXPECT_EQ(a.AllocateChannel(), 0u);
  omni_.keeps_registers_at_reset = true;
  EXPECT_EQ(a.Write(0x1000, 3), 0u);
  const std::int64_t from_ns = NowNs();
  bus_.BusReset();
  a.generation = WordAt(a.Next(), kNew);
  EXPECT_EQ(omni_.Register(0x1000), 3);
  const Bytes lost = a.Next();
  EXPECT_EQ(WordAt(lost, kType), FW_CDEV_EVENT_ISO_RESOURCE_DEALLOCATED * 1u);
  EXPECT_EQ(WordAt(lost, kChannel), static_cast<std::uint32_t>(-EBUSY));
  EXPECT_EQ(a.AllocateChannel(), 0u);
  EXPECT_GT(NowNs() - from_ns, 900'000'000);

  // Packets without an interrupt come when they are asked for.
  ASSERT_EQ(a.Create(FW_CDEV_ISO_CONTEXT_RECEIVE, 0), 0);
  EXPECT_EQ(a.Queue({0, 0, 0, 3 * kSlotBytes}), 1);
  EXPECT_EQ(a.Start(), 0);
  EXPECT_EQ(a.Write(0x1001, 0), 0u);
  EXPECT_EQ(a.Write(0x1087, 8), 0u);
  EXPECT_TRUE(Eventually([&] { return omni_.Counts().lost > 0; }));
  EXPECT_EQ(a.Call(FW_CDEV_IOC_FLUSH_ISO, fw_cdev_flush_iso{}), 0);
  EXPECT_EQ(WordAt(a.Next(), kLength), 3u * kSlotBytes);

  omni_.AnswerNext(1, kNoResponse, 0x1087);
  EXPECT_EQ(a.Call(FW_CDEV_IOC_SEND_REQUEST, fw_cdev_send_request{.tcode = TCODE_READ_BLOCK_REQUEST,
                                                                  .length = 1,
                                                                  .offset = 0x1087,
                                                                  .closure = 0,
                                                                  .data = 0,
                                                                  .generation = a.generation}),
            0);
  pollfd one = a.Poll();
  EXPECT_EQ(poll(&one, 1, 20), 0);
  EXPECT_EQ(a.Call(FW_CDEV_IOC_GET_CYCLE_TIMER, fw_cdev_get_cycle_timer{}), -1);
  EXPECT_EQ(omni_.Mistakes().size(), 1u);
}

}  // namespace
}  // namespace palpate::test
