palpate_unit_test(lab_judges_test lab_judges_test.cpp palpate::lab)
palpate_unit_test(lab_replay_test lab_replay_test.cpp palpate::lab)
