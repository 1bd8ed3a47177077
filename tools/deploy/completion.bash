# Completion of the programs' options and subcommands, as --help tells them.
_sogm_swarm() {
  local program=$1 word=${COMP_WORDS[COMP_CWORD]} help
  local -a command=("$program")
  if [[ ${program##*/} == swarm_sim ]]; then
    if ((COMP_CWORD == 1)); then
      mapfile -t COMPREPLY < <(compgen -W "world run campaign merge audit --help --version" -- "$word")
      return
    fi
    command+=("${COMP_WORDS[1]}")
  fi
  [[ $word == -* ]] || return 0  # files
  help=$("${command[@]}" --help 2> /dev/null | grep -oE -- '(^|[ ,])--[a-z0-9-]+' | tr -d ' ,' | sort -u)
  mapfile -t COMPREPLY < <(compgen -W "$help" -- "$word")
}
complete -o default -F _sogm_swarm map_daemon planner_daemon broadcast_daemon keeper_daemon perception_daemon mavlink_bridge mocap_input \
  swarm_sim swarm_view swarm_goal swarm_status swarm_map swarm_hear swarm_scan_player log_info lcm2mcap identify \
  swarm_control swarm_record swarm_replay swarm_spy
