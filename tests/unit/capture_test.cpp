// Captures of real devices, decoded: those in tests/data/captures/<kind>/ and in
// $PALPATE_CAPTURES/<kind>/. deploy/guides/devices.md says how they are made, and what
// they prove. A synthetic capture, written here, proves that this test can tell.
#include <gtest/gtest.h>
#include <pcap/pcap.h>
#include <pcap/usb.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <optional>
#include <random>
#include <sstream>

#include "server/device/omni/omni_usb_protocol.h"
#include "tests/support/omni_frames.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/usb_capture.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using test::UsbTransfer;
using Settings = std::map<std::string, int>;

// What a decoder made of one capture.
struct Judgement {
  std::size_t in_bytes = 0;
  std::size_t corrupt_bytes = 0;  // in no frame
  bool names_frames = false;      // the capture's text file says which they are
  std::size_t readings = 0;
  std::size_t rises = 0;  // readings whose number is a little above the last one's
  std::size_t calibrated = 0;
  std::size_t within_box = 0;  // of the calibrated ones
  std::string summary{};       // for whoever looks for command bytes
};

// Within the workspace, larger by half of its size at each side: the dock is there too.
bool IsNearWorkspace(const DeviceSpec& spec, const Vec3& p_mm) {
  const Vec3 margin_mm = 0.5 * (spec.workspace_max_mm - spec.workspace_min_mm);
  return ((p_mm - spec.workspace_min_mm + margin_mm).array() >= 0.0).all() &&
         ((spec.workspace_max_mm + margin_mm - p_mm).array() >= 0.0).all();
}

OmniUsbParser ParserFor(const Settings& settings) {
  OmniUsbParser parser;
  if (settings.contains("state_command")) {
    parser.Expect({static_cast<std::uint8_t>(settings.at("state_command")), kOmniStateBytes});
  }
  return parser;
}

// Which frames there are, of what length and how often: "in 0x21: 44 bytes, 1000/s".
std::string FrameTable(const std::vector<UsbTransfer>& transfers, const char* direction) {
  std::map<std::pair<int, std::size_t>, int> counts;
  OmniUsbParser parser;
  for (const UsbTransfer& transfer : transfers) {
    std::span<const std::uint8_t> bytes = transfer.payload;
    while (const auto frame = parser.Next(bytes)) ++counts[{frame->command, frame->payload.size()}];
  }
  const double time_s =
      transfers.empty() ? 0.0 : transfers.back().time_s - transfers.front().time_s;
  std::ostringstream table;
  for (const auto& [frame, count] : counts) {
    table << "  " << direction << " 0x" << std::hex << frame.first << std::dec << ": "
          << frame.second << " bytes, " << count << " times";
    if (time_s > 0.0) table << ", " << std::lround(count / time_s) << "/s";
    table << "\n";
  }
  return table.str();
}

void JudgeReadings(const std::vector<UsbTransfer>& in, const Settings& settings,
                   Judgement& judgement) {
  OmniUsbOptions options;
  options.frames = OmniUsbFrames::kFramedFirewire;
  options.init_payload.emplace();
  options.state_command = static_cast<std::uint8_t>(settings.at("state_command"));
  options.force_command = static_cast<std::uint8_t>(
      settings.contains("force_command") ? settings.at("force_command") : 0);
  OmniUsbProtocol protocol(options);
  OmniUsbParser parser = ParserFor(settings);
  std::optional<std::uint32_t> counter;
  for (const UsbTransfer& transfer : in) {
    std::span<const std::uint8_t> bytes = transfer.payload;
    while (const auto frame = parser.Next(bytes)) {
      if (frame->command != options.state_command) continue;
      const auto omni = DecodeOmniState(frame->payload);
      if (!omni) continue;
      ++judgement.readings;
      judgement.rises += !counter || omni->counter - *counter - 1 < 100;
      counter = omni->counter;
    }
    DeviceState state;
    if (!protocol.Receive(transfer.payload, state).has_reading || !state.calibrated) continue;
    ++judgement.calibrated;
    judgement.within_box += IsNearWorkspace(protocol.spec(), state.p_DHip_mm);
  }
}

Judgement JudgeOmniUsb(const std::vector<UsbTransfer>& transfers, const Settings& settings) {
  const auto in = test::OfBusiestEndpoint(transfers, true);
  Judgement judgement;
  OmniUsbParser parser = ParserFor(settings);
  for (const UsbTransfer& transfer : in) {
    std::span<const std::uint8_t> bytes = transfer.payload;
    judgement.in_bytes += bytes.size();
    while (parser.Next(bytes)) {
    }
  }
  judgement.corrupt_bytes = parser.corrupt_bytes();
  judgement.summary =
      FrameTable(in, "in ") + FrameTable(test::OfBusiestEndpoint(transfers, false), "out");
  judgement.names_frames = settings.contains("state_command");
  if (judgement.names_frames) JudgeReadings(in, settings, judgement);
  return judgement;
}

// Kind: its decoder.
using Decoder = std::function<Judgement(const std::vector<UsbTransfer>&, const Settings&)>;
const std::map<std::string, Decoder>& Decoders() {
  static const std::map<std::string, Decoder> decoders = {{"omni-usb", JudgeOmniUsb}};
  return decoders;
}

constexpr const char* kNoFrames = "over 1 % of the bytes are in no frame";
constexpr const char* kNumbersStand = "the readings' numbers do not rise";
constexpr const char* kNeverDocked = "no reading is docked: begin with the stylus in its dock";
constexpr const char* kFarOff = "positions far off the workspace";

// What is wrong with it; "": nothing.
std::string ProblemOf(const Judgement& judgement) {
  const auto most = [](std::size_t part, std::size_t all) { return part >= 0.99 * all; };
  if (judgement.in_bytes == 0) return "nothing came in";
  if (!most(judgement.in_bytes - judgement.corrupt_bytes, judgement.in_bytes)) {
    return kNoFrames;
  }
  if (!judgement.names_frames) return "";
  if (judgement.readings == 0) return "no frame is a reading";
  if (!most(judgement.rises, judgement.readings)) return kNumbersStand;
  if (judgement.calibrated == 0) return kNeverDocked;
  if (!most(judgement.within_box, judgement.calibrated)) return kFarOff;
  return "";
}

Judgement Judge(const std::string& kind, const std::filesystem::path& file) {
  const Settings settings = test::CaptureSettings(file);
  const auto device = settings.contains("device") ? settings.at("device") : 0;
  return Decoders().at(kind)(
      test::OfDevice(test::ReadUsbCapture(file), static_cast<std::uint8_t>(device)), settings);
}

std::vector<std::filesystem::path> Captures(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  if (!std::filesystem::is_directory(folder)) return files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const auto extension = entry.path().extension();
    if (extension == ".pcap" || extension == ".pcapng") files.push_back(entry.path());
  }
  return files;
}

TEST(Captures, OfRealDevicesAreDecoded) {
  std::vector<std::filesystem::path> roots = {test::kCaptures};
  if (const char* folder = std::getenv("PALPATE_CAPTURES")) roots.emplace_back(folder);
  int count = 0;
  for (const auto& root : roots) {
    for (const auto& [kind, decoder] : Decoders()) {
      for (const auto& file : Captures(root / kind)) {
        SCOPED_TRACE(file.string());
        ++count;
        const Judgement judgement = Judge(kind, file);
        std::cout << file.string() << "\n" << judgement.summary;
        EXPECT_EQ(ProblemOf(judgement), "");
      }
    }
  }
  if (count == 0) GTEST_SKIP() << "there are none yet";
}

// Writes events as usbmon does.
class CaptureWriter {
 public:
  CaptureWriter(const std::filesystem::path& file, int linktype)
      : linktype_(linktype),
        capture_(pcap_open_dead(linktype, 65535)),
        dumper_(pcap_dump_open(capture_, file.c_str())) {
    if (!dumper_) throw std::runtime_error(pcap_geterr(capture_));
  }
  ~CaptureWriter() {
    pcap_dump_close(dumper_);
    pcap_close(capture_);
  }
  CaptureWriter(const CaptureWriter&) = delete;
  CaptureWriter& operator=(const CaptureWriter&) = delete;

  // Both events of one transfer, a ms after the last.
  void Transfer(std::uint8_t device, std::uint8_t endpoint, const Bytes& payload,
                std::uint8_t type = URB_BULK) {
    const bool in = (endpoint & 0x80) != 0;
    Event(device, endpoint, type, URB_SUBMIT, in ? Bytes() : payload);
    Event(device, endpoint, type, URB_COMPLETE, in ? payload : Bytes());
    ++time_ms_;
  }

 private:
  void Event(std::uint8_t device, std::uint8_t endpoint, std::uint8_t type, char event,
             const Bytes& payload) {
    pcap_usb_header_mmapped header{};
    header.event_type = static_cast<std::uint8_t>(event);
    header.transfer_type = type;
    header.endpoint_number = endpoint;
    header.device_address = device;
    header.bus_id = 1;
    header.data_flag = payload.empty() ? '<' : 0;
    header.ts_sec = time_ms_ / 1000;
    header.ts_usec = static_cast<std::int32_t>(1000 * (time_ms_ % 1000));
    header.data_len = static_cast<std::uint32_t>(payload.size());
    Bytes bytes(linktype_ == DLT_USB_LINUX ? sizeof(pcap_usb_header) : sizeof header);
    std::memcpy(bytes.data(), &header, bytes.size());
    bytes.insert(bytes.end(), payload.begin(), payload.end());
    pcap_pkthdr packet{};
    packet.caplen = packet.len = static_cast<std::uint32_t>(bytes.size());
    pcap_dump(reinterpret_cast<u_char*>(dumper_), &packet, bytes.data());
  }

  int linktype_;
  pcap_t* capture_;
  pcap_dumper_t* dumper_;
  long time_ms_ = 0;
};

struct Flaws {
  bool numbers_stand = false;
  bool never_docked = false;
  bool far_off = false;
  unsigned garbage_per_mille = 0;
};

// Three seconds of a Touch as our assumption has it, in transfers of 64 bytes, among
// other traffic.
void WriteSynthetic(const std::filesystem::path& file, int linktype, const Flaws& flaws = {}) {
  std::mt19937 random(1);
  CaptureWriter writer(file, linktype);
  Bytes stream;
  for (int n = 0; n < 3000; ++n) {
    const double way = flaws.far_off ? 1.0 : 0.2;
    const auto turn = [&](double share) {
      return n < 100 ? 0 : static_cast<int>(way * 7000 * std::sin(share * (n - 100)));
    };
    const Bytes frame = test::Framed(
        0x21, test::OmniStatePayload(
                  {.encoders = {turn(0.003), 0, std::abs(turn(0.002))},
                   .docked = n < 100 && !flaws.never_docked,
                   .counter = flaws.numbers_stand ? 7 : 0xfffffff0u + static_cast<unsigned>(n)}));
    stream.insert(stream.end(), frame.begin(), frame.end());
    for (unsigned i = 0; i < frame.size(); ++i) {
      if (random() % 1000 < flaws.garbage_per_mille) stream.push_back(0x11);
    }
    while (stream.size() >= 64) {
      writer.Transfer(5, 0x82, Bytes(stream.begin(), stream.begin() + 64));
      stream.erase(stream.begin(), stream.begin() + 64);
    }
    writer.Transfer(5, 0x03, test::Framed(0x22, EncodeOmniForce({})));
    if (n % 10 == 0) {
      writer.Transfer(5, 0x81, {0xa1, 0x20}, URB_INTERRUPT);
      writer.Transfer(5, 0x00, {1, 2, 3}, URB_CONTROL);
      writer.Transfer(9, 0x81, Bytes(300, 0xee));  // another device
    }
  }
  std::ofstream(std::filesystem::path(file).replace_extension(".txt"))
      << "# learned from nothing: this one is synthetic\nstate_command = 0x21\n"
         "force_command = 34  # 0x22\n\ndevice=5\n";
}

std::string JudgeSynthetic(int linktype, const Flaws& flaws = {}) {
  const test::TemporaryFolder folder;
  const auto kind = folder.path() / "omni-usb";
  std::filesystem::create_directory(kind);
  WriteSynthetic(kind / "synthetic-touch.pcap", linktype, flaws);
  const auto files = Captures(kind);
  EXPECT_EQ(files.size(), 1u);
  return ProblemOf(Judge("omni-usb", files.at(0)));
}

TEST(SyntheticCapture, IsDecodedInBothLinktypesAndWhatIsWrongIsSeen) {
  constexpr int kType = DLT_USB_LINUX_MMAPPED;
  EXPECT_EQ(JudgeSynthetic(DLT_USB_LINUX), "");
  EXPECT_EQ(JudgeSynthetic(kType), "");
  EXPECT_EQ(JudgeSynthetic(kType, {.numbers_stand = true}), kNumbersStand);
  EXPECT_EQ(JudgeSynthetic(kType, {.never_docked = true}), kNeverDocked);
  EXPECT_EQ(JudgeSynthetic(kType, {.far_off = true}), kFarOff);
  EXPECT_EQ(JudgeSynthetic(kType, {.garbage_per_mille = 100}), kNoFrames);
}

TEST(SyntheticCapture, WithoutTheTextFileItsFramesAreListed) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "synthetic-touch.pcap";
  WriteSynthetic(file, DLT_USB_LINUX_MMAPPED);
  std::filesystem::remove(folder.path() / "synthetic-touch.txt");
  const Judgement judgement = Judge("omni-usb", file);
  EXPECT_EQ(ProblemOf(judgement), "");
  EXPECT_EQ(judgement.readings, 0u);
  EXPECT_NE(judgement.summary.find("in  0x21: 44 bytes, "), std::string::npos);
  EXPECT_NE(judgement.summary.find("out 0x22: 16 bytes, 3000 times"), std::string::npos)
      << judgement.summary;
}

TEST(UsbCapture, TransfersAreTakenOnceWithTheirEndpoint) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "synthetic.pcap";
  {
    CaptureWriter writer(file, DLT_USB_LINUX);
    writer.Transfer(3, 0x81, {1, 2});
    writer.Transfer(3, 0x02, {3});
    writer.Transfer(3, 0x00, {4}, URB_CONTROL);
    writer.Transfer(3, 0x83, {5}, URB_INTERRUPT);
    writer.Transfer(3, 0x81, {});
  }
  const auto transfers = test::ReadUsbCapture(file);
  ASSERT_EQ(transfers.size(), 3u);
  EXPECT_EQ(transfers[0].endpoint, 0x81);
  EXPECT_EQ(transfers[0].payload, (Bytes{1, 2}));
  EXPECT_EQ(transfers[1].endpoint, 0x02);
  EXPECT_EQ(transfers[2].payload, Bytes{5});
  EXPECT_DOUBLE_EQ(transfers[2].time_s, 0.003);
  EXPECT_EQ(test::OfBusiestEndpoint(transfers, true).size(), 1u);
}

TEST(UsbCapture, OtherFilesAreRefused) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(test::ReadUsbCapture(folder.path() / "none.pcap"), std::runtime_error);
  std::ofstream(folder.path() / "text.pcap") << "no capture";
  EXPECT_THROW(test::ReadUsbCapture(folder.path() / "text.pcap"), std::runtime_error);
  { CaptureWriter ethernet(folder.path() / "ethernet.pcap", DLT_EN10MB); }
  EXPECT_THROW(test::ReadUsbCapture(folder.path() / "ethernet.pcap"), std::runtime_error);
  const auto cut = folder.path() / "cut.pcap";
  WriteSynthetic(cut, DLT_USB_LINUX);
  std::filesystem::resize_file(cut, 5000);
  EXPECT_THROW(test::ReadUsbCapture(cut), std::runtime_error);
  std::ofstream(folder.path() / "cut.txt") << "state_command = many\n";
  EXPECT_THROW(test::CaptureSettings(cut), std::runtime_error);
}

}  // namespace
}  // namespace palpate
