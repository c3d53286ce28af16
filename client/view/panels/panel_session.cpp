#include <fmt/format.h>
#include <imgui.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <ctime>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/view/palpated/panel_words.h"
#include "client/view/panels/overlays.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

constexpr std::size_t kLongestText = 200;  // bytes
constexpr int kRowsOfList = 6;

// One line, always with its room: what comes below it never moves. The tooltip has what does
// not fit, up to kLongestText.
void FixedLine(const std::string& whole, const ImVec4& color) {
  const std::string text = OneLine(whole, kLongestText);
  const ImVec2 p = ImGui::GetCursorScreenPos();
  const ImVec2 room{std::max(1.0f, ImGui::GetContentRegionAvail().x),
                    ImGui::GetTextLineHeightWithSpacing()};
  ImGui::PushClipRect(p, {p.x + room.x, p.y + room.y}, true);
  ImGui::GetWindowDrawList()->AddText(p, ImGui::GetColorU32(color), text.c_str());
  ImGui::PopClipRect();
  ImGui::Dummy(room);
  if (!text.empty() && ImGui::IsItemHovered()) ImGui::SetTooltip("%s", text.c_str());
}

// What there is to record to.
struct Record {
  client::RecordingState state;
  std::shared_ptr<const client::RecordingList> list;  // null: not known yet
  std::string problem;                                // why the name cannot be taken

  const client::RecordingList& known() const {
    static const client::RecordingList none;
    return list ? *list : none;
  }
};

Record RecordOf(const Viewer& viewer) {
  const LiveFeed& feed = viewer.feed();
  Record record{.state = feed.recording().value_or(client::RecordingState{}),
                .list = feed.replayer().list(),
                .problem = WhyNot(viewer, client::Role::kOperator)};
  if (record.problem.empty()) record.problem = "asking palpated\xE2\x80\xA6";
  if (record.list) record.problem = NameProblem(viewer.state().session.name, *record.list);
  return record;
}

void NameField(SessionState& session, const Record& record) {
  ImGui::SetNextItemWidth(-FLT_MIN);
  if (record.state.running) {
    std::string name = RecordingName(record.state.path);
    ImGui::InputText("##running", &name, ImGuiInputTextFlags_ReadOnly);
  } else {
    ImGui::InputTextWithHint("##name", "name of the recording", &session.name);
  }
  const std::string& folder = record.known().folder;
  const std::string where = folder.empty() ? "palpated's folder" : folder;
  Tip(("a file in " + OneLine(where, kLongestText) + ", on palpated's machine").c_str());
}

void RecordedSoFar(const client::RecordingState& recording) {
  if (!recording.running) {
    ImGui::TextColored(kDim, "not recording");
    return;
  }
  const std::string more = recording.lost_ticks > 0
                               ? fmt::format("{} ticks lost", recording.lost_ticks)
                               : SizeText(recording.size_bytes);
  ImGui::TextColored(kBad, "%s, %s", TimeText(recording.ticks).c_str(), more.c_str());
}

// The line below the name: why it cannot be taken, or how the last recording ended.
void NameLine(SessionState& session, const Record& record) {
  if (record.state.running || record.problem.empty()) {
    const bool is_bad = !record.state.error.empty();
    FixedLine(is_bad ? record.state.error : record.state.left_out, is_bad ? kBad : kWarning);
    return;
  }
  const ImVec2 p = ImGui::GetCursorPos();
  FixedLine(record.problem, kWarning);
  const std::string next = FreeName(session.name, record.known());
  if (session.name.empty() || next == session.name || record.known().folder.empty()) return;
  const ImVec2 after = ImGui::GetCursorPos();
  const std::string use = "Use " + OneLine(next, 30) + "###use";
  const float width = ImGui::CalcTextSize(use.c_str(), nullptr, true).x;
  ImGui::SetCursorPos({std::max(p.x, ImGui::GetContentRegionMax().x - width - 10.0f), p.y});
  if (ImGui::SmallButton(use.c_str())) session.name = next;
  Tip("the next free name");
  ImGui::SetCursorPos(after);
}

void MarkerLine(Viewer& viewer, bool runs) {
  ImGui::BeginDisabled(!runs);
  const float gap = 8.0f * viewer.state().screen_scale;
  ImGui::SetNextItemWidth(-ButtonWidth("Mark") - gap);
  const bool entered =
      ImGui::InputTextWithHint("##marker", "what happened", &viewer.state().session.marker,
                               ImGuiInputTextFlags_EnterReturnsTrue);
  Tip("text of the next marker; Enter or K puts it");
  ImGui::SameLine(0.0f, gap);
  if (ImGui::Button("Mark") || entered) PutMarker(viewer);
  Tip("a marker with the present time (K)");
  ImGui::EndDisabled();
}

void RecordPart(Viewer& viewer) {
  const Record record = RecordOf(viewer);
  NameField(viewer.state().session, record);
  RecordedSoFar(record.state);
  NameLine(viewer.state().session, record);
  MarkerLine(viewer, record.state.running);
}

std::string DayText(std::int64_t modified_s) {
  const auto time = static_cast<std::time_t>(modified_s);
  std::tm local{};
  localtime_r(&time, &local);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%d %b %H:%M", &local);
  return text.data();
}

void ListLine(Viewer& viewer, const client::RecordedFile& file) {
  std::string& chosen = viewer.state().session.chosen;
  ImGui::PushID(file.path.c_str());
  if (NameSelectable(OneLine(RecordingName(file.path), 60), chosen == file.path,
                     ImGuiSelectableFlags_AllowDoubleClick)) {
    chosen = file.path;
    if (ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left) && !IsRecording(viewer)) {
      viewer.feed().replayer().Play(file.path);
    }
  }
  ImGui::PopID();
  const std::string day = DayText(file.modified_s);
  if (ImGui::IsItemHovered()) {
    ImGui::SetTooltip("%s\n%s, %s; double click: replay", OneLine(file.path, kLongestText).c_str(),
                      day.c_str(), SizeText(file.size_bytes).c_str());
  }
  ImGui::SameLine(ImGui::GetContentRegionMax().x - ImGui::CalcTextSize(day.c_str()).x);
  ImGui::TextColored(kDim, "%s", day.c_str());
}

void ListPart(Viewer& viewer) {
  Replayer& replayer = viewer.feed().replayer();
  ImGui::AlignTextToFramePadding();
  ImGui::TextUnformatted("Recordings");
  ImGui::SameLine(ImGui::GetContentRegionMax().x - ButtonWidth("Refresh"));
  if (ImGui::Button("Refresh")) replayer.Refresh();
  Tip("ask palpated for its recordings again");
  const float height =
      kRowsOfList * ImGui::GetTextLineHeightWithSpacing() + 6.0f * viewer.state().screen_scale;
  ImGui::BeginChild("recordings", {0.0f, height}, true);
  const auto list = replayer.list();
  if (list && list->recordings.empty()) ImGui::TextColored(kDim, "none yet");
  ImGuiListClipper clipper;
  clipper.Begin(list ? static_cast<int>(list->recordings.size()) : 0);
  while (clipper.Step()) {
    for (int n = clipper.DisplayStart; n < clipper.DisplayEnd; ++n) {
      ListLine(viewer, list->recordings[static_cast<std::size_t>(n)]);
    }
  }
  ImGui::EndChild();
}

// Lines over the slider where the markers are, with their texts as tooltips.
void DrawMarkers(const ReplayPosition& position) {
  const ImVec2 min = ImGui::GetItemRectMin();
  const ImVec2 max = ImGui::GetItemRectMax();
  // As Dear ImGui places the grab.
  const float edge = 2.0f + 0.5f * ImGui::GetStyle().GrabMinSize;
  const float width = max.x - min.x - 2.0f * edge;
  const auto last = static_cast<double>(std::max<std::uint64_t>(position.total_ticks, 2) - 1);
  const float pointer = ImGui::GetIO().MousePos.x;
  const client::RecordedMarker* pointed = nullptr;
  float nearest = 5.0f;
  static const std::vector<client::RecordedMarker> none;
  for (const client::RecordedMarker& marker : position.markers ? *position.markers : none) {
    const float x =
        min.x + edge + width * static_cast<float>(static_cast<double>(marker.tick) / last);
    ImGui::GetWindowDrawList()->AddLine({x, min.y}, {x, max.y}, ImGui::GetColorU32(kWarning), 2.0f);
    if (std::abs(x - pointer) < nearest) {
      nearest = std::abs(x - pointer);
      pointed = &marker;
    }
  }
  if (!ImGui::IsItemHovered()) return;
  if (pointed) {
    ImGui::SetTooltip("%s  %s", TimeText(pointed->tick).c_str(),
                      OneLine(pointed->text, kLongestText).c_str());
  } else if (!ImGui::IsItemActive()) {
    ImGui::SetTooltip("click or drag: go there");
  }
}

void Timeline(Viewer& viewer, const ReplayPosition& position) {
  SessionState& session = viewer.state().session;
  std::uint64_t tick = session.sought.value_or(position.tick);
  const std::uint64_t first = 0;
  const std::uint64_t last = std::max<std::uint64_t>(position.total_ticks, 2) - 1;
  const std::string format = TimeText(tick);
  ImGui::SetNextItemWidth(-FLT_MIN);
  ImGui::SliderScalar("##timeline", ImGuiDataType_U64, &tick, &first, &last, format.c_str(),
                      ImGuiSliderFlags_AlwaysClamp | ImGuiSliderFlags_NoInput);
  if (ImGui::IsItemActive()) session.sought = tick;
  if (ImGui::IsItemDeactivated()) {
    if (session.sought && ImGui::IsItemDeactivatedAfterEdit()) {
      viewer.feed().replayer().Seek(*session.sought);
    }
    session.sought.reset();
  }
  DrawMarkers(position);
}

void SpeedChoice(Viewer& viewer, const ReplayPosition& position) {
  constexpr std::array<double, 7> kSpeeds = {0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0};
  constexpr std::array<std::string_view, 7> kNames = {
      "\xC3\x97 0.1", "\xC3\x97 0.25", "\xC3\x97 0.5", "\xC3\x97 1",
      "\xC3\x97 2",   "\xC3\x97 4",    "\xC3\x97 10"};
  const auto* const found = std::find(kSpeeds.begin(), kSpeeds.end(), position.speed);
  std::size_t choice =
      found == kSpeeds.end() ? 3 : static_cast<std::size_t>(found - kSpeeds.begin());
  ImGui::SetNextItemWidth(-FLT_MIN);
  if (Choose("##speed", choice, kNames)) viewer.feed().replayer().SetSpeed(kSpeeds[choice]);
  Tip("multiple of real time");
}

void ReplayPart(Viewer& viewer) {
  Replayer& replayer = viewer.feed().replayer();
  const std::string& chosen = viewer.state().session.chosen;
  const auto playing = replayer.position();
  const ReplayPosition position = playing.value_or(ReplayPosition{});
  const char* const label = !playing             ? "Replay###replay"
                            : position.is_paused ? "Play###replay"
                                                 : "Pause###replay";
  const bool others = !playing && viewer.feed().is_replay();
  ImGui::BeginDisabled(!playing && (chosen.empty() || IsRecording(viewer) || others));
  if (ImGui::Button(label, {ButtonWidth("Replay"), 0.0f})) {
    playing ? replayer.SetPaused(!position.is_paused) : replayer.Play(chosen);
  }
  Tip("shows the recording to all viewers, with forces off; the recorded volume must be loaded");
  ImGui::EndDisabled();
  ImGui::BeginDisabled(!playing);
  const float gap = 8.0f * viewer.state().screen_scale;
  ImGui::SameLine(0.0f, gap);
  if (ImGui::Button("Live again")) replayer.End();
  Tip("ends the replay: voxels, place and forces are as before");
  ImGui::SameLine(0.0f, gap);
  SpeedChoice(viewer, position);
  Timeline(viewer, position);
  ImGui::EndDisabled();
  if (playing) {
    FixedLine(TimeText(position.tick) + " of " + TimeText(position.total_ticks) + ", " +
                  RecordingName(position.path),
              kWarning);
  } else if (others) {
    FixedLine("somebody else replays", kWarning);
  } else {
    const std::string problem = replayer.problem();
    // While the connection is lost, nothing shown is live.
    const bool is_live = viewer.feed().connection().state == client::ConnectionState::kConnected &&
                         !viewer.feed().silent_s();
    FixedLine(problem.empty() && is_live ? "live" : problem, problem.empty() ? kDim : kBad);
  }
}

// Empty: nothing is replayed. Between two parts of our own replay the live state is back for a
// moment; the banner stays.
std::string BannerOf(const LiveFeed& feed) {
  const auto line = [](bool is_paused, std::uint64_t tick, std::uint64_t total_ticks) {
    return std::string("REPLAY ") + (is_paused ? "paused " : "") + TimeText(tick) + " of " +
           TimeText(total_ticks);
  };
  if (const auto own = feed.replayer().position()) {
    return line(own->is_paused, own->tick, own->total_ticks);
  }
  if (!feed.is_replay()) return {};
  const auto recording = feed.recording();
  if (!recording || !recording->replay) return "REPLAY";
  const client::RunningReplay& replay = *recording->replay;
  return line(client::IsPaused(replay), replay.ticks, replay.total_ticks);
}

}  // namespace

bool IsRecording(const Viewer& viewer) {
  const auto recording = viewer.feed().recording();
  return recording && recording->running;
}

// Asks for the list at the beginning and after each recording. Then the next name is free, too.
void FollowSession(Viewer& viewer) {
  SessionState& session = viewer.state().session;
  LiveFeed& feed = viewer.feed();
  if (feed.connection().state != client::ConnectionState::kConnected) {
    session.asked = false;
    session.watch = {};
    return;
  }
  const auto recording = feed.recording();
  const RecordingEvent event =
      session.watch.Take(recording ? std::optional<bool>(recording->running) : std::nullopt);
  if (event == RecordingEvent::kBegun) session.markers = 0;
  const bool ended = event == RecordingEvent::kEnded;
  if (!feed.May(client::Role::kOperator) || (session.asked && !ended)) return;
  session.asked = true;
  feed.replayer().Refresh();
  if (!ended) return;
  const auto known = feed.replayer().list();
  client::RecordingList list = known ? *known : client::RecordingList{};
  list.recordings.push_back({.path = recording->path});
  session.name = FreeName(session.name, list);
  session.chosen = recording->path;
}

std::string WhyNotRecord(const Viewer& viewer) {
  const Record record = RecordOf(viewer);
  if (record.state.running) return WhyNot(viewer, client::Role::kOperator);
  const bool replays = viewer.feed().is_replay() || viewer.feed().replayer().position();
  return replays ? "a recording is replayed" : record.problem;
}

void ToggleRecording(Viewer& viewer) {
  const Record record = RecordOf(viewer);
  if (record.state.running) {
    viewer.feed().StopRecording();
  } else {
    viewer.feed().StartRecording(RecordingPath(record.known().folder, viewer.state().session.name));
  }
}

void PutMarker(Viewer& viewer) {
  SessionState& session = viewer.state().session;
  if (!IsRecording(viewer)) {
    viewer.Say("no marker: nothing is recorded");
    return;
  }
  ++session.markers;
  const std::string text =
      session.marker.empty() ? "marker " + std::to_string(session.markers) : session.marker;
  session.marker.clear();
  viewer.feed().commands().Do("mark", [text](client::Client& client) { client.Mark(text); });
  viewer.Say("marked: " + OneLine(text, kLongestText));
}

void SessionPanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Session", ImGuiTreeNodeFlags_DefaultOpen)) return;
  BeginAllowed(viewer, client::Role::kOperator);
  RecordPart(viewer);
  ReplayPart(viewer);
  ListPart(viewer);
  EndAllowed();
}

void DrawReplayBanner(const Viewer& viewer, const Area& area, float scale) {
  const std::string line = BannerOf(viewer.feed());
  if (line.empty()) return;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImU32 color = ImGui::GetColorU32(kWarning);
  const ImVec2 max = MaxOf(area);
  const float edge = 3.0f * scale;
  list.AddRect({area.min.x + 0.5f * edge, area.min.y + 0.5f * edge},
               {max.x - 0.5f * edge, max.y - 0.5f * edge}, color, 0.0f, 0, edge);
  const float x = area.min.x + 0.5f * (area.size.x - ImGui::CalcTextSize(line.c_str()).x);
  DrawLabel(list, {x, area.min.y + 12.0f * scale},
            {.text = line, .color = IM_COL32(20, 16, 8, 255), .ground = color}, scale);
}

}  // namespace palpate::view
