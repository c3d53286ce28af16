#include "server/recording/recording_reader.h"

#include <charconv>
#include <fstream>
#include <limits>
#include <utility>
#include <variant>

#include "common/error/error.h"
#include "common/wire/values.h"
#include "server/recording/bytes.h"
#include "server/recording/recorded_messages.h"
#include "server/recording/voxel_log.h"

namespace palpate {
namespace {

// After this one, none could come.
constexpr std::uint64_t kNoTick = std::numeric_limits<std::uint64_t>::max();
// Twice what is written.
constexpr std::size_t kMostMessageBytes = std::size_t{512} << 10;

std::unique_ptr<std::istream> Open(const std::filesystem::path& file) {
  // Opening a pipe would block until a writer comes.
  std::error_code unknown;
  const std::filesystem::file_status status = std::filesystem::status(file, unknown);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    throw Error(ErrorKind::kInvalidArgument, file.string() + " is no file");
  }
  auto stream = std::make_unique<std::ifstream>(file, std::ios::binary);
  if (!*stream) {
    throw Error(ErrorKind::kNotFound, "cannot open the recording " + file.string());
  }
  return stream;
}

[[noreturn]] void RefuseFile(const std::string& file, const std::string& why) {
  throw Error(ErrorKind::kInvalidArgument, file + " " + why);
}

std::unique_ptr<mcap::Reader> OpenMcap(std::unique_ptr<std::istream> stream,
                                       const std::string& name) {
  try {
    return std::make_unique<mcap::Reader>(std::move(stream));
  } catch (const DamagedBytes& damage) {
    RefuseFile(name, std::string("is no recording of Palpate: it is ") + damage.what());
  }
}

template <class Number>
Number NumberOf(const mcap::Texts& texts, const std::string& key) {
  const auto found = texts.find(key);
  const std::string_view text = found == texts.end() ? "" : std::string_view(found->second);
  Number number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) {
    throw DamagedBytes("damaged: its " + key + " is no number");
  }
  return number;
}

std::uint64_t TickOf(const RecordedItem& item) {
  const auto* samples = std::get_if<RecordedSamples>(&item);
  if (samples) return samples->front().tick;
  return std::visit(
      [](const auto& held) {
        if constexpr (requires { held.tick; }) return held.tick;
        return std::uint64_t{0};
      },
      item);
}

}  // namespace

bool BeginsAsRecording(std::istream& stream) {
  // Magic, the head of the first record, an empty profile, and the length of the library.
  constexpr std::size_t kLibraryPlace = mcap::kMagic.size() + mcap::kRecordHeadBytes + 4 + 4;
  std::string start(kLibraryPlace + kLibraryStart.size(), '\0');
  stream.read(start.data(), static_cast<std::streamsize>(start.size()));
  return stream && start.starts_with(mcap::kMagic) && start.ends_with(kLibraryStart);
}

struct RecordingReader::Messages {
  // Returns null if the message is of another topic, or somebody else's.
  template <class Message>
  Message* Parse(const mcap::Reader& file, const mcap::Message& in, const char* topic,
                 Message& message) const {
    if (in.channel->topic != topic || file.SchemaOf(in) != Message::descriptor()->full_name()) {
      return nullptr;
    }
    // A message of empty parts takes a hundred times its bytes.
    if (in.data.size() > kMostMessageBytes ||
        !message.ParseFromArray(in.data.data(), static_cast<int>(in.data.size()))) {
      throw DamagedBytes(std::string("damaged: a message of ") + topic + " makes no sense");
    }
    return &message;
  }

  v1::RecordedTick tick;
  v1::RecordedScene scene;
  v1::RecordedVoxels voxels;
  v1::RecordedKeyframe keyframe;
  v1::RecordedEvent event;
};

RecordingReader::RecordingReader(const std::filesystem::path& file)
    : RecordingReader(Open(file), file.string()) {}

RecordingReader::RecordingReader(std::unique_ptr<std::istream> stream, std::string name)
    : name_(std::move(name)),
      file_(OpenMcap(std::move(stream), name_)),
      messages_(std::make_unique<Messages>()) {
  // The header comes before the first message.
  try {
    pending_ = ReadItem();
  } catch (const DamagedBytes& damage) {
    damage_ = damage.what();
  }
  const auto found = file_->metadata().find(kHeaderMetadata);
  if (found == file_->metadata().end()) {
    RefuseFile(name_, damage_.empty() ? "is an MCAP file, but no recording of Palpate"
                                      : "ends within its header, or is damaged there");
  }
  const mcap::Texts& texts = found->second;
  try {
    header_.created_unix_ns = NumberOf<std::int64_t>(texts, "created_unix_ns");
    if (texts.contains("created_monotonic_ns")) {
      header_.created_monotonic_ns = NumberOf<std::int64_t>(texts, "created_monotonic_ns");
    }
  } catch (const DamagedBytes& damage) {
    RefuseFile(name_, std::string("is ") + damage.what());
  }
  if (texts.contains("program")) header_.program = texts.at("program");
}

RecordingReader::~RecordingReader() = default;

std::optional<RecordedItem> RecordingReader::Next() {
  if (complete_ || !stopped_because_.empty()) return std::nullopt;
  try {
    return Read();
  } catch (const DamagedBytes& damage) {
    StopBecause(std::string("it is ") + damage.what());
  }
  complete_ = false;
  return std::nullopt;
}

std::optional<RecordedItem> RecordingReader::Read() {
  if (!pending_ && !damage_.empty()) throw DamagedBytes(damage_);
  if (!pending_) pending_ = ReadItem();
  if (!pending_) return ReadEnd();
  const std::uint64_t tick = TickOf(*pending_);
  const bool goes_back = next_tick_ && tick < *next_tick_;
  if (goes_back || tick == kNoTick) throw DamagedBytes("damaged: its ticks go back");
  if (next_tick_ && tick > *next_tick_) return GapUntil(tick);
  next_tick_ = tick;
  RecordedItem item = std::move(*pending_);
  pending_.reset();
  if (auto* samples = std::get_if<RecordedSamples>(&item)) Extend(*samples);
  return item;
}

std::optional<RecordedItem> RecordingReader::ReadItem() {
  try {
    while (const std::optional<mcap::Message> next = file_->Next()) {
      if (std::optional<RecordedItem> item = ItemOf(*next)) return item;
    }
  } catch (const Error& error) {
    throw DamagedBytes(std::string("damaged: ") + error.what());
  }
  return std::nullopt;
}

std::optional<RecordedItem> RecordingReader::ItemOf(const mcap::Message& next) {
  Messages& messages = *messages_;
  if (next.channel->topic.starts_with(kFurtherHands)) throw DamagedBytes(kSeveralHands);
  if (const auto* tick = messages.Parse(*file_, next, kTickTopic, messages.tick)) {
    return RecordedSamples{SampleOf(FromProto(*tick))};
  }
  if (const auto* scene = messages.Parse(*file_, next, kSceneTopic, messages.scene)) {
    edit_bricks_ = 0;
    return FromProto(*scene);
  }
  if (auto* voxels = messages.Parse(*file_, next, kVoxelsTopic, messages.voxels)) {
    RecordedEdit edit = FromProto(std::move(*voxels));
    edit_bricks_ += edit.BrickCount();
    if (edit_bricks_ > VoxelLog::kMaxBricksPerScene) {
      throw DamagedBytes("damaged: of too many bricks");
    }
    return edit;
  }
  if (const auto* keyframe = messages.Parse(*file_, next, kKeyframeTopic, messages.keyframe)) {
    return FromProto(*keyframe);
  }
  const auto* event = messages.Parse(*file_, next, kEventTopic, messages.event);
  if (!event || event->marker().empty()) return std::nullopt;
  if (event->marker().size() > kMaxMarkerBytes) throw DamagedBytes("damaged: a marker is too long");
  return FromProto(*event);
}

// What follows the samples may be damaged: it is told after them.
void RecordingReader::Extend(RecordedSamples& samples) {
  ++*next_tick_;
  try {
    while (samples.size() < kSamplesPerChunk) {
      pending_ = ReadItem();
      const auto* next = pending_ ? std::get_if<RecordedSamples>(&*pending_) : nullptr;
      if (!next || next->front().tick != *next_tick_ || *next_tick_ == kNoTick) break;
      samples.push_back(next->front());
      pending_.reset();
      ++*next_tick_;
    }
  } catch (const DamagedBytes& damage) {
    pending_.reset();
    damage_ = damage.what();
  }
  ticks_ += samples.size();
}

RecordedItem RecordingReader::GapUntil(std::uint64_t tick) {
  const RecordedGap gap{.first_tick = *next_tick_, .last_tick = tick - 1};
  lost_ticks_ += tick - *next_tick_;
  next_tick_ = tick;
  return gap;
}

std::optional<RecordedItem> RecordingReader::ReadEnd() {
  const auto found = file_->metadata().find(kEndMetadata);
  if (!file_->is_complete() || found == file_->metadata().end()) {
    StopBecause("it was not closed");
    return std::nullopt;
  }
  const std::uint64_t lost = NumberOf<std::uint64_t>(found->second, "lost_ticks") - lost_ticks_;
  const std::uint64_t end = next_tick_.value_or(0) + lost;
  const bool is_tick = next_tick_ ? end >= *next_tick_ : lost == 0;
  if (!is_tick || NumberOf<std::uint64_t>(found->second, "ticks") != ticks_) {
    throw DamagedBytes("damaged: its counts do not fit");
  }
  // The last ticks were lost, too.
  if (lost > 0) return GapUntil(end);
  complete_ = true;
  return std::nullopt;
}

void RecordingReader::StopBecause(const std::string& what) {
  stopped_because_ = name_ + ": " + what + ", after " + std::to_string(ticks_) + " ticks";
}

}  // namespace palpate
