# Names of modules, points and codes, from the configuration.
_railbus_named() {
    local -a names
    names=(${(f)"$(railbus complete -- "${words[@]:1:$((CURRENT-1))}" 2>/dev/null)"})
    (( $#names )) && compadd -a names
    _railbus "$@"
}
