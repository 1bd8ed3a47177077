# Sourced by spy, record and replay: which bus is meant. The same URLs as in lcmtypes/bus/bus_url.h.
# shellcheck shell=bash disable=SC2034

bus_usage="  --onboard ID   the bus inside robot ID where several share this computer (port 7700 + ID); on its own computer: 0
  --swarm        the bus between the robots
  --url URL      any other, udpm://ADDRESS:PORT?ttl=N
"

die() {
  echo "$(basename "$0"): $*" >&2
  exit 2
}

# Reads one bus option from "$@" into bus_url and its word count into bus_words (0: not a bus option).
read_bus_option() {
  bus_words=0
  local url=""
  case ${1:-} in
    --onboard)
      [[ ${2:-} =~ ^[0-9]{1,5}$ && $((10#$2)) -le 32767 ]] || die "--onboard ${2:-}: must be a robot id within [0, 32767]"
      url="udpm://239.255.76.67:$((7700 + 10#$2))?ttl=0"
      bus_words=2
      ;;
    --swarm)
      url="udpm://239.255.76.68:7667?ttl=1"
      bus_words=1
      ;;
    --url)
      [[ ${2:-} == udpm://* ]] || die "--url ${2:-}: must be udpm://ADDRESS:PORT?ttl=N"
      url=$2
      bus_words=2
      ;;
    *) return 0 ;;
  esac
  [[ -z ${bus_url:-} ]] || die "$1: a bus is already named"
  # A map comes as a burst that must fit the receive buffer.
  [[ $url == *recv_buf_size=* ]] || url+="$([[ $url == *\?* ]] && echo '&' || echo '?')recv_buf_size=2097152"
  bus_url=$url
}

require() {
  command -v "$1" > /dev/null || die "$1 is not installed; run tools/setup${2:+ $2}"
}
