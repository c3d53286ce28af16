// The letters of the patient's axes as lines, so that every picture of the view has them.
//
// Frame: D (mm). Threads: pure functions.
#pragma once

#include "client/view/scene/overlay.h"

namespace palpate::view {

// `letter`: one of LRAPSI. `right_D` and `up_D` are as long as the letter is high.
void AddLetter(char letter, const Vec3& center_D, const Vec3& right_D, const Vec3& up_D,
               Overlay& overlay);

}  // namespace palpate::view
