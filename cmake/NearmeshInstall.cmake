# Install and export; tests/consumer proves that the result can be used with find_package(nearmesh).
