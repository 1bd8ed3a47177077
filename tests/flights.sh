# Sourced: flights that are compared with others.

# Takes what depends on the wall clock out of a flight's report. without_wall_clock DIRECTORY
without_wall_clock() { sed -E -i '/"(wall|mean|p50|p95|p99|max|processor)":/d' "$1/report.json"; }
