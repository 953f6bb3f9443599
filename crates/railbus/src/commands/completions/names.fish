
# Names of modules, points and codes, from the configuration.
function __railbus_names
    set -l words (commandline -opc)
    railbus complete -- $words[2..-1] (commandline -ct) 2>/dev/null
end
complete -c railbus -f -a '(__railbus_names)'
