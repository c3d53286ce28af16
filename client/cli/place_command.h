// `palpate place`: where the volume lies in the device's workspace.
//
// Frame D (mm, x right, y up, z towards the user) and units as in
// registration.proto. Errors of calls: as Connection::ErrorOf and WriteOutput.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/v1/registration.pb.h"

namespace palpate::cli {

class Connection;

void ShowPlace(const Connection& connection, bool json);

// Prints the new place and since which tick it holds.
void ChangePlace(const Connection& connection, const v1::UpdateRegistrationRequest& request,
                 bool json);

// Pure, any thread:

// Lines that end with \n.
std::string Describe(const v1::Registration& registration);
nlohmann::ordered_json ToJson(const v1::Registration& registration);
// Of "x,90", "y,-7.5": an axis of the device and degrees. False where it is neither.
bool ParseTurn(std::string_view text, v1::Quaternion& rotation);
// `values` holds three.
void Set(const std::vector<double>& values, v1::Vector3& vector);

}  // namespace palpate::cli
