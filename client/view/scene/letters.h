// The letters of the patient's axes as lines, so that every picture of the view has them.
//
// Frame: D (mm). Threads: pure functions.
#pragma once

#include <string_view>

#include "client/view/scene/overlay.h"

namespace palpate::view {

// `letters`: of LRAPSI. `right_D` and `up_D` are as long as a letter is high.
void AddLetters(std::string_view letters, const Vec3& center_D, const Vec3& right_D,
                const Vec3& up_D, Overlay& overlay);

}  // namespace palpate::view
