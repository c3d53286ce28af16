palpate_unit_test(wire_test wire_test.cpp palpate::wire)
