palpate_unit_test(realtime_test realtime_test.cpp CORE palpate::realtime)
palpate_unit_test(latest_value_test latest_value_test.cpp CORE palpate::realtime)
