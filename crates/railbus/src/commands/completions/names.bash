
# Names of modules, points and codes, from the configuration.
_railbus_named() {
    _railbus "$@"
    local current="${COMP_WORDS[COMP_CWORD]}" name
    case "$current" in -*) return 0 ;; esac
    while IFS= read -r name; do
        COMPREPLY+=("$name")
    done < <(railbus complete -- "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
    return 0
}
complete -F _railbus_named -o bashdefault -o default railbus
