// The table of roles against the services as they are.
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "palpate/v1/activity.pb.h"
#include "palpate/v1/device.pb.h"
#include "palpate/v1/facts.pb.h"
#include "palpate/v1/pose.pb.h"
#include "palpate/v1/recording.pb.h"
#include "palpate/v1/registration.pb.h"
#include "palpate/v1/render.pb.h"
#include "palpate/v1/series.pb.h"
#include "palpate/v1/volume.pb.h"
#include "server/security/methods.h"

namespace palpate {
namespace {

TEST(Methods, TheTableHasAllOfThemOnce) {
  std::set<std::string> served;
  for (const auto* message :
       {v1::GetDeviceRequest::descriptor(), v1::StreamPosesRequest::descriptor(),
        v1::MarkRequest::descriptor(), v1::GetRegistrationRequest::descriptor(),
        v1::GetSettingsRequest::descriptor(), v1::GetSeriesRequest::descriptor(),
        v1::GetVolumeRequest::descriptor(), v1::GetActivityRequest::descriptor(),
        v1::FollowRequest::descriptor()}) {
    const auto* file = message->file();
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m) {
        const auto* method = file->service(s)->method(m);
        served.insert("/" + method->service()->full_name() + "/" + method->name());
      }
    }
  }
  EXPECT_GE(served.size(), 27u);
  std::set<std::string> listed;
  for (const MethodRule& rule : MethodRules()) {
    EXPECT_TRUE(listed.insert(std::string(rule.method)).second) << rule.method;
  }
  EXPECT_EQ(listed, served);
}

// Written out, so that no change of the table goes unnoticed: who may do it answers for it.
TEST(Methods, EachRoleMayDoWhatItAnswersFor) {
  const std::set<std::string> editors = {"UpdateSettings", "UpdateRegistration", "EditVolume",
                                         "UndoEdit",       "RedoEdit",           "RevertVolume",
                                         "FilterVolume",   "ControlSeries",      "Mark"};
  // Those that move a hand, and those that reach files, memory or what all viewers see.
  const std::set<std::string> operators = {
      "EnableForces",  "DisableForces",  "CalibrateDevice", "PushHand",   "LeadHand",
      "LoadVolume",    "UploadVolume",   "SaveVolume",      "LoadSeries", "StartRecording",
      "StopRecording", "ListRecordings", "Replay"};
  std::set<std::string> of_editors, of_operators;
  for (const MethodRule& rule : MethodRules()) {
    const std::string name(rule.method.substr(rule.method.rfind('/') + 1));
    if (rule.least == Role::kEditor) of_editors.insert(name);
    if (rule.least == Role::kOperator) of_operators.insert(name);
    EXPECT_EQ(rule.least == Role::kAdmin, name == "EndCaller") << name;
  }
  EXPECT_EQ(of_editors, editors);
  EXPECT_EQ(of_operators, operators);
}

TEST(Methods, OnlyQuestionsAndTheStopAreForViewers) {
  for (const MethodRule& rule : MethodRules()) {
    const std::string_view name = rule.method.substr(rule.method.rfind('/') + 1);
    const bool asks = name.starts_with("Get") || name.starts_with("Stream") ||
                      name == "ListDevices" || name == "Follow";
    EXPECT_EQ(rule.least == Role::kViewer, asks || name == "StopForces") << name;
    EXPECT_EQ(rule.kind == CallKind::kStop, name == "StopForces") << name;
  }
  EXPECT_FALSE(FindMethodRule(""));
  EXPECT_FALSE(FindMethodRule("/palpate.v1.PoseService/streamposes"));
  EXPECT_FALSE(FindMethodRule("palpate.v1.PoseService/StreamPoses"));
}

}  // namespace
}  // namespace palpate
