// Every setting, over real gRPC and by the client, while a real daemon is felt.
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/support/daemon.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

using google::protobuf::FieldDescriptor;

// The contract, as README has it; said again here so that a slip is seen.
struct Number {
  const char* key;
  double start, low, high;
  const char* unit;
};
constexpr Number kNumbers[] = {
    {"stiffness_n_per_mm", 0.5, 0.0, 3.0, " N/mm"},
    {"damping_n_s_per_m", 0.0, 0.0, 5.0, " N·s/m"},
    {"static_friction", 0.0, 0.0, 2.0, ""},
    {"dynamic_friction", 0.0, 0.0, 2.0, ""},
    {"viscosity_n_s_per_m", 0.0, 0.0, 5.0, " N·s/m"},
    {"pop_force_n", 0.0, 0.0, 3.3, " N"},
    {"magnet_force_n", 0.0, 0.0, 1.5, " N"},
    {"magnet_range_mm", 2.0, 0.0, 10.0, " mm"},
    {"carve_radius_mm", 2.0, 0.1, 20.0, " mm"},
    {"carve_rate_per_s", 2.0, -20.0, 20.0, " 1/s"},
};
constexpr const char* kFlags[] = {"force_shading", "passivity_control", "carve_tool",
                                  "clutch_tool"};

const FieldDescriptor* Field(const std::string& key) {
  return v1::RenderSettings::descriptor()->FindFieldByName(key);
}

double Get(const v1::RenderSettings& settings, const std::string& key) {
  return settings.GetReflection()->GetDouble(settings, Field(key));
}

class SettingsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    daemon_ = std::make_unique<Daemon>(test::kPalpated,
                                       std::vector<std::string>{"--volume", "builtin:bumps:32"});
  }

  v1::GetSettingsResponse Settings() {
    grpc::ClientContext context;
    v1::GetSettingsResponse response;
    EXPECT_TRUE(daemon_->render->GetSettings(&context, {}, &response).ok());
    return response;
  }
  grpc::Status Update(const v1::RenderSettings& settings, const std::string& key) {
    v1::UpdateSettingsRequest request;
    *request.mutable_settings() = settings;
    request.mutable_update_mask()->add_paths(key);
    grpc::ClientContext context;
    last_ = {};
    return daemon_->render->UpdateSettings(&context, request, &last_);
  }
  grpc::Status UpdateNumber(const std::string& key, double value) {
    v1::RenderSettings settings;
    settings.GetReflection()->SetDouble(&settings, Field(key), value);
    return Update(settings, key);
  }
  ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  std::unique_ptr<Daemon> daemon_;
  v1::UpdateSettingsResponse last_;
};

TEST_F(SettingsTest, EveryEffectIsOffAtFirst) {
  const v1::RenderSettings settings = Settings().settings();
  for (const Number& number : kNumbers) {
    EXPECT_EQ(Get(settings, number.key), number.start) << number.key;
  }
  for (const char* flag : kFlags) {
    EXPECT_FALSE(settings.GetReflection()->GetBool(settings, Field(flag))) << flag;
  }
  EXPECT_EQ(settings.free_side(), v1::FREE_SIDE_BELOW);
}

TEST_F(SettingsTest, EachNumberIsSetAloneAndReadBack) {
  v1::RenderSettings expected = Settings().settings();
  std::uint64_t tick = 0;
  for (const Number& number : kNumbers) {
    SCOPED_TRACE(number.key);
    for (const double value : {number.low, number.high, 0.37 * number.high}) {
      ASSERT_TRUE(UpdateNumber(number.key, value).ok());
      expected.GetReflection()->SetDouble(&expected, Field(number.key), value);
      EXPECT_EQ(last_.settings().SerializeAsString(), expected.SerializeAsString());
      EXPECT_EQ(Settings().settings().SerializeAsString(), expected.SerializeAsString());
      EXPECT_EQ(Settings().settings_revision(), last_.settings_revision());
      EXPECT_GT(last_.applied_tick(), tick);
      tick = last_.applied_tick();
    }
  }
}

TEST_F(SettingsTest, FlagsAndTheFreeSideAreSetAndReadBack) {
  v1::RenderSettings expected = Settings().settings();
  for (const bool on : {true, false}) {
    for (const char* flag : kFlags) {
      expected.GetReflection()->SetBool(&expected, Field(flag), on);
      ASSERT_TRUE(Update(expected, flag).ok()) << flag;
      EXPECT_EQ(Settings().settings().SerializeAsString(), expected.SerializeAsString()) << flag;
    }
    expected.set_free_side(on ? v1::FREE_SIDE_ABOVE : v1::FREE_SIDE_BELOW);
    ASSERT_TRUE(Update(expected, "free_side").ok());
    EXPECT_EQ(Settings().settings().SerializeAsString(), expected.SerializeAsString());
  }
}

TEST_F(SettingsTest, OneUpdateSetsMany) {
  v1::UpdateSettingsRequest request;
  v1::RenderSettings& settings = *request.mutable_settings();
  settings.set_static_friction(0.2);  // below the dynamic one: allowed
  settings.set_dynamic_friction(0.6);
  settings.set_passivity_control(true);
  for (const char* key : {"static_friction", "dynamic_friction", "passivity_control"}) {
    request.mutable_update_mask()->add_paths(key);
  }
  const std::uint64_t before = Settings().settings_revision();
  grpc::ClientContext context;
  ASSERT_TRUE(daemon_->render->UpdateSettings(&context, request, &last_).ok());
  EXPECT_EQ(last_.settings_revision(), before + 1);
  EXPECT_EQ(last_.settings().static_friction(), 0.2);
  EXPECT_EQ(last_.settings().dynamic_friction(), 0.6);
  EXPECT_TRUE(last_.settings().passivity_control());
}

TEST_F(SettingsTest, BadValuesAreRefusedAndChangeNothing) {
  const std::string before = Settings().SerializeAsString();
  for (const Number& number : kNumbers) {
    for (const double bad : {std::nextafter(number.high, HUGE_VAL), number.low - 1e-9, std::nan(""),
                             HUGE_VAL, -HUGE_VAL}) {
      const grpc::Status status = UpdateNumber(number.key, bad);
      EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << number.key << bad;
      const std::string text = status.error_message();
      EXPECT_EQ(text.rfind(std::string(number.key) + " ", 0), 0u) << text;
      EXPECT_NE((text + "\n").find(std::string(number.unit) + "\n"), std::string::npos) << text;
    }
  }
  v1::RenderSettings settings;
  settings.set_free_side(v1::FREE_SIDE_UNSPECIFIED);
  EXPECT_EQ(Update(settings, "free_side").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Update({}, "force_shading").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Settings().SerializeAsString(), before);
}

TEST_F(SettingsTest, TheClientSetsEachByItsKeyAndShowsIt) {
  std::vector<std::pair<std::string, nlohmann::json>> wanted;
  for (const Number& number : kNumbers) wanted.emplace_back(number.key, 0.5 * number.high);
  for (const char* flag : kFlags) wanted.emplace_back(flag, true);
  wanted.emplace_back("free_side", "above");
  wanted.emplace_back("method", "bcc");
  for (const auto& [key, value] : wanted) {
    const std::string text = value.is_string() ? value.get<std::string>() : value.dump();
    const ProcessResult result = Run({"set", key, text});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    EXPECT_NE(result.output.find("applied at tick"), std::string::npos) << result.output;
  }
  const auto shown = nlohmann::json::parse(Run({"settings", "--json"}).output);
  for (const auto& [key, value] : wanted) EXPECT_EQ(shown[key], value) << key;
  EXPECT_EQ(Run({"settings"}).output.find("off:"), std::string::npos);
  const ProcessResult refused = Run({"set", "pop_force", "4"});
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_EQ(refused.error, "palpate: pop_force_n 4 is not within 0 to 3.3 N\n");
}

}  // namespace
}  // namespace palpate::test
