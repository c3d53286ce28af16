palpate_unit_test(lab_mesh_test lab_mesh_test.cpp palpate::lab)
