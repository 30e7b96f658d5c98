# Prints the text of --help as a man page, up to the exit codes: -v name=… -v title='DATE "VERSION" "MANUAL"'.
function text(s) { gsub(/\\/, "\\e", s); gsub(/-/, "\\-", s); return s ~ /^[.']/ ? "\\&" s : s }
function section(title) { if (now != title) print ".SH " title; now = title }
{ line[NR] = $0 }
END {
  sub(/\.$/, "", line[1]); sub(/^Usage: /, "", line[2])
  print ".TH " toupper(text(name)) " 1 " title "\n.nh\n.ad l"
  print ".SH NAME\n" text(name) " \\- " text(line[1]) "\n.SH SYNOPSIS\n" text(line[2])
  for (i = 3; i <= NR && line[i] !~ /^Exit codes: /; ++i) {  # these: the same for all, below
    if (line[i] ~ /^[A-Z][a-z]*:$/) {
      heading = line[i]
    } else if (line[i] ~ /^Exit code /) {
      codes = text(line[i])
    } else if (line[i] ~ /^[^ ]/) {
      section("NOTES"); print text(line[i])
    } else if (heading == "Examples:" && line[i] != "") {
      section("EXAMPLES"); print (line[i] ~ /^   / ? "" : ".PP\n") text(substr(line[i], 3))
    } else if (line[i] != "") {
      # A row has the option "  -o,--out TEXT Excludes: --json" and, from column 31 or on the next line, its
      # description.
      left = substr(line[i], 3, 28); right = substr(line[i], 31)
      if (substr(line[i + 1], 1, 30) ~ /^ +$/) { left = substr(line[i], 3); right = substr(line[++i], 31) }
      more = ""
      if (match(left, / (\(Env:|Needs:|Excludes:)/)) { more = "\n.br\n" text(substr(left, RSTART + 1)); left = substr(left, 1, RSTART - 1) }
      sub(/ +$/, "", left)
      if (heading == "Subcommands:") { section("VERBS"); left = name "-" left "(1)" }
      else section(heading == "Positionals:" ? "ARGUMENTS" : "OPTIONS")
      end = match(left " ", / /); rest = text(substr(left, end)); gsub(/,/, ",\\:", rest)
      print ".TP\n\\fB" text(substr(left, 1, end - 1)) "\\fR" rest "\n" text(right) more
    }
  }
  print ".SH EXIT STATUS" (codes == "" ? "" : "\n" codes)
}
