# SPDX-License-Identifier: Apache-2.0
# Makes shell completions of what the four programs print for --print-options.
#   awk -v shell=bash|zsh|fish -f completion.awk
# Columns: command, option or sub-command, letter, value, kind, choices, default, file, help.
# A command is known under each name that leads to it: `umbrage render` and `umbrage-study render`.
BEGIN { FS = "\t"; count = 0 }

# Records a name, once, in the order of first use.
function add_name(name) {
    if (!(name in words)) {
        names[++count] = name
        words[name] = ""
    }
}

# Adds an option, or says which files stand in a command's place.
function add_option(name, option) {
    add_name(name)
    if (option !~ /^--/) {
        places[name] = files_of(option)
    } else if (index(" " words[name] " ", " " option " ") == 0) {
        words[name] = words[name] (words[name] == "" ? "" : " ") option
        options[name] = options[name] $0 "\n"
    }
}

$5 == "command" || $5 == "program" {
    add_name($1)
    commands[$1] = commands[$1] (commands[$1] == "" ? "" : " ") $2
    summary[$1 " " $2] = $9
    add_name($1 " " $2)
    if ($5 == "program") started[$1 " " $2] = $6
    next
}
$2 != "" { rows[++row_count] = $0 }

# Options of a command's name: its own rows, and those of the program that it starts.
END {
    for (r = 1; r <= row_count; r++) {
        $0 = rows[r]
        add_option($1, $2)
        if ($1 ~ /^umbrage (render|points|aliasing|study)$/) {
            name = $1
            sub(/^umbrage /, "umbrage-study ", name)
            if (name in words) add_option(name, $2)
        }
        if ($1 == "umbrage-study verify") add_option("umbrage verify", $2)
        if ($1 == "umbrage-bake") add_option("umbrage bake", $2)
        if ($1 == "umbrage-bake") {
            add_option("umbrage-bake tile", $2)
            add_option("umbrage-bake merge", $2)
            add_option("umbrage-bake import", $2)
        }
        if ($1 == "umbrage study") add_option("umbrage-study", $2)
    }
    if (shell == "bash") print_bash()
    if (shell == "zsh") print_zsh()
    if (shell == "fish") print_fish()
}

# Returns how an option's value is completed: the words of a choice, "file", or "" for nothing.
function values_of(fields) {
    if (fields[6] != "") {
        gsub(/\|+/, " ", fields[6])
        sub(/^ /, "", fields[6])
        return fields[6]
    }
    return fields[4] ~ /^SCENE$/ ? files_of(fields[4]) : fields[4] ~ /FILE|DIR|SCENE|PART/ ? "file" : ""
}

# Returns "file" and the endings of the files that an argument names, or "" for no file.
function files_of(argument) {
    return argument ~ /SCENE/ ? "file glb gltf obj ply stl" : argument ~ /FILE/ ? "file umb umbm" : ""
}

# Returns the endings with something between them.
function endings_of(values, between) {
    sub(/^file ?/, "", values)
    gsub(/ /, between, values)
    return values
}

function quoted(text) {
    gsub(/'/, "'\\''", text)
    return "'" text "'"
}

function print_bash(    i, k, n, lines, fields, letter) {
    print "# Completions of umbrage, umbraged, umbrage-bake and umbrage-study for bash; made by make."
    print "_umbrage_words() { # COMMAND: its options; \"COMMAND \" and an option: its values"
    print "    case $1 in"
    for (i = 1; i <= count; i++) {
        printf "    %s) echo %s ;;\n", quoted(names[i]), quoted(words[names[i]])
        n = split(options[names[i]], lines, "\n")
        for (k = 1; k < n; k++) {
            split(lines[k], fields, "\t")
            if (fields[4] == "" && fields[6] == "") continue
            letter = fields[3] != "" ? " | " quoted(names[i] " " fields[3]) : ""
            printf "    %s%s) echo %s ;;\n", quoted(names[i] " " fields[2]), letter, quoted("=" values_of(fields))
        }
        if (places[names[i]] != "") printf "    %s) echo %s ;;\n", quoted(names[i] " @"), quoted("=" places[names[i]])
    }
    print "    esac"
    print "}"
    print "_umbrage_commands() {"
    print "    case $1 in"
    for (i = 1; i <= count; i++)
        if (commands[names[i]] != "") printf "    %s) echo %s ;;\n", names[i], quoted(commands[names[i]])
    print "    esac"
    print "}"
    print "_umbrage_files() { # WORD, endings: folders, and files with one of the endings, or all"
    print "    local word=$1 ending"
    print "    shift"
    print "    compopt -o filenames 2>/dev/null"
    print "    [[ $# -eq 0 ]] && compgen -f -- \"$word\" && return"
    print "    compgen -d -- \"$word\""
    print "    for ending; do compgen -f -X \"!*.$ending\" -- \"$word\"; done"
    print "}"
    print "_umbrage() {"
    print "    local program=${COMP_WORDS[0]##*/} word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}"
    print "    local command=$program commands values"
    print "    commands=$(_umbrage_commands \"$program\")"
    print "    [[ $COMP_CWORD -gt 1 && \" $commands \" == *\" ${COMP_WORDS[1]} \"* ]] && command=\"$program ${COMP_WORDS[1]}\""
    print "    if [[ $word == '=' ]]; then word=; fi"
    print "    if [[ $before == '=' ]]; then before=${COMP_WORDS[COMP_CWORD-2]}; fi"
    print "    values=$(_umbrage_words \"$command $before\")"
    print "    COMPREPLY=()"
    print "    if [[ -z $values && $word != -* && ! ($COMP_CWORD -eq 1 && -n $commands) ]]; then"
    print "        values=$(_umbrage_words \"$command @\")"
    print "    fi"
    print "    if [[ $values == '=file'* ]]; then"
    print "        compopt -o filenames 2>/dev/null"
    print "        mapfile -t COMPREPLY < <(_umbrage_files \"$word\" ${values#=file})"
    print "    elif [[ $values == =* ]]; then"
    print "        mapfile -t COMPREPLY < <(compgen -W \"${values#=}\" -- \"$word\")"
    print "    elif [[ $word == -* ]]; then"
    print "        mapfile -t COMPREPLY < <(compgen -W \"$(_umbrage_words \"$command\")\" -- \"$word\")"
    print "    elif [[ $COMP_CWORD -eq 1 && -n $commands ]]; then"
    print "        values=$(_umbrage_words \"$command @\")"
    print "        mapfile -t COMPREPLY < <(compgen -W \"$commands\" -- \"$word\""
    print "            [[ $values == '=file'* ]] && _umbrage_files \"$word\" ${values#=file})"
    print "    fi"
    print "}"
    print "complete -F _umbrage umbrage umbraged umbrage-bake umbrage-study"
}

# Escapes a text for its place in zsh's '--option[text]:name:action'.
function zsh_text(text) {
    gsub(/\\/, "\\\\", text)
    gsub(/:/, "\\:", text)
    gsub(/\[/, "\\[", text)
    gsub(/\]/, "\\]", text)
    return text
}

function zsh_files(values) {
    return values == "file" ? "_files" : "_files -g \"*.(" endings_of(values, "|") ")\""
}

function zsh_spec(line,    fields, action, spec) {
    split(line, fields, "\t")
    spec = fields[2] "[" zsh_text(fields[9]) "]"
    if (fields[4] != "" || fields[6] != "") {
        action = values_of(fields)
        action = action ~ /^file/ ? zsh_files(action) : action != "" ? "(" action ")" : " "
        spec = fields[2] "=[" zsh_text(fields[9]) "]:" zsh_text(fields[4] != "" ? fields[4] : "value") ":" action
    }
    return quoted("*" spec)
}

function print_zsh(    i, k, n, lines, list) {
    print "#compdef umbrage umbraged umbrage-bake umbrage-study"
    print "# Completions of umbrage, umbraged, umbrage-bake and umbrage-study for zsh; made by make."
    print "local program=${words[1]:t}"
    print "local command=$program"
    for (i = 1; i <= count; i++) {
        if (commands[names[i]] == "") continue
        printf "if [[ $program == %s ]]; then\n", names[i]
        n = split(commands[names[i]], list, " ")
        printf "    local -a commands=("
        for (k = 1; k <= n; k++) printf "%s%s", (k > 1 ? " " : ""), quoted(list[k] ":" zsh_text(summary[names[i] " " list[k]]))
        print ")"
        print "    (( CURRENT == 2 )) && [[ ${words[2]} != -* ]] && _describe command commands"
        printf "    case ${words[2]} in %s) command=\"$program ${words[2]}\" ;; esac\n", joined(commands[names[i]])
        print "fi"
    }
    print "case $command in"
    for (i = 1; i <= count; i++) {
        n = split(options[names[i]], lines, "\n")
        if (n < 2) continue
        printf "%s) _arguments", quoted(names[i])
        for (k = 1; k < n; k++) printf " %s", zsh_spec(lines[k])
        print (places[names[i]] != "" ? " " quoted("*:file:" zsh_files(places[names[i]])) : "") " ;;"
    }
    print "esac"
}

function joined(list) {
    gsub(/ /, "|", list)
    return list
}

function fish_text(text) {
    gsub(/\\/, "\\\\", text)
    gsub(/'/, "\\'", text)
    return "'" text "'"
}

# Returns the condition under which fish offers the options of a command's name.
function fish_condition(name,    parts) {
    split(name, parts, " ")
    if (parts[2] != "") return "__fish_seen_subcommand_from " parts[2]
    return commands[name] != "" ? "not __fish_seen_subcommand_from " commands[name] : ""
}

function print_fish(    i, k, n, lines, fields, parts, list, condition, values) {
    print "# Completions of umbrage, umbraged, umbrage-bake and umbrage-study for fish; made by make."
    for (i = 1; i <= count; i++) {
        split(names[i], parts, " ")
        condition = fish_condition(names[i])
        n = split(commands[names[i]], list, " ")
        for (k = 1; k <= n; k++)
            printf "complete -c %s -n %s -a %s -d %s\n", parts[1], quoted(fish_condition(names[i])), list[k], fish_text(summary[names[i] " " list[k]])
        n = split(endings_of(places[names[i]], " "), list, " ")
        for (k = 1; k <= n; k++)
            printf "complete -c %s -n %s -f -k -a %s\n", parts[1], quoted(condition == "" ? "true" : condition), quoted("(__fish_complete_suffix ." list[k] ")")
        n = split(options[names[i]], lines, "\n")
        for (k = 1; k < n; k++) {
            split(lines[k], fields, "\t")
            printf "complete -c %s", parts[1]
            if (condition != "") printf " -n %s", quoted(condition)
            printf " -l %s", substr(fields[2], 3)
            if (fields[3] != "") printf " -s %s", substr(fields[3], 2)
            if (fields[4] != "" || fields[6] != "") {
                values = values_of(fields)
                printf "%s", (values ~ /^file/ ? " -r -F" : " -x")
                if (values !~ /^file/ && values != "") printf " -a %s", quoted(values)
            }
            printf " -d %s\n", fish_text(fields[9])
        }
    }
}
