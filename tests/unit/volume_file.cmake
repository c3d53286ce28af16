palpate_unit_test(volume_file_test volume_file_test.cpp palpate::volume)
