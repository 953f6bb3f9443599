
# Names of modules, points and codes, from the configuration.
var railbus-fixed~ = $edit:completion:arg-completer[railbus]
set edit:completion:arg-completer[railbus] = {|@words|
    railbus-fixed $@words
    try { railbus complete -- $@words[1..] 2>/dev/null | from-lines } catch _ { }
}
