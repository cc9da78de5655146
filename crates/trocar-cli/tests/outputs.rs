//! No output replaces an input, and no argument ends a verb in a panic: over all verbs.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{Place, Ran};

/// Command lines that together make every verb write all that it can, with all of its inputs.
const LINES: [&str; 12] = [
    "simulate model.json motion.csv --out force.csv",
    "compensate model.json recording.csv --force-error-n 0.1 --out tissue.csv",
    "identify recording.csv --validate held.csv --prior model.json --out result",
    "compare recording.csv --validate held.csv --models coulomb --out compared",
    "fleet set --out set/fleet.csv",
    "fleet manifest.csv --out table.parquet --report report.html",
    "plan plan.toml --model model.json --after held.csv --out next.csv --report plan.html",
    "bench --motion motion.csv --rig rig.toml --seal model.json --out made.csv --truth-out truth.csv",
    "bench step --rig rig.toml --out step.csv",
    "teleop loop.toml --model model.json --compensator other.json --out tried",
    "export c model.json --out seal.c",
    "export fmu model.json --source --out seal.fmu",
];

/// Verbs that write without reading any file.
const NO_INPUT: [&str; 2] = ["demo", "man"];

const RIG: &str = "[rig]\nsample_rate_hz = 200.0\n[protocol.steady]\nfastest_m_s = 0.06\n";

/// A place with all inputs of [`LINES`].
fn with_inputs() -> Place {
    let place = Place::new();
    let put = |name: &str, text: &str| fs::write(place.path(name), text).unwrap();
    put("rig.toml", RIG);
    put("plan.toml", "duration_s = 60.0\n");
    put("loop.toml", "[motion]\nduration_s = 1.0\n");
    put("manifest.csv", "path\nheld.csv\n");
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../conformance/models");
    for name in ["model.json", "other.json"] {
        fs::copy(models.join("ems.json"), place.path(name)).unwrap();
    }
    place.run("bench steady --rig rig.toml --out recording.csv").ends_with(0);
    place.run("bench validation --rig rig.toml --out held.csv").ends_with(0);
    let motion: String = (0..400).fold("time_s,position_m\n".to_owned(), |text, k: i32| {
        text + &format!(
            "{},{}\n",
            f64::from(k) * 0.005,
            0.1 + 1e-4 * f64::from((k % 200 - 100).abs())
        )
    });
    put("motion.csv", &motion);
    fs::create_dir(place.path("set")).unwrap();
    fs::copy(place.path("held.csv"), place.path("set/held.csv")).unwrap();
    place
}

/// All files below a folder, and their bytes.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => all.extend(files(&path)),
            false => drop(all.insert(path.clone(), fs::read(&path).unwrap())),
        }
    }
    all
}

fn assert_no_panic(line: &str, ran: &Ran) {
    assert!(ran.code != Some(101) && !ran.stderr.contains("panicked"), "{line}: {ran:#?}");
}

/// The commands that the program has.
fn verbs() -> Vec<String> {
    let listed = |arguments: &str| -> Vec<String> {
        let help = Place::new().run(arguments).ends_with(0).stdout;
        let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
        let names = lines.take_while(|line| !line.is_empty()).filter_map(|line| {
            line.strip_prefix("  ").filter(|line| !line.starts_with(' '))?.split(' ').next()
        });
        names.filter(|name| *name != "help").map(str::to_owned).collect()
    };
    let inner = |verb: String| match listed(&format!("{verb} --help")) {
        inner if inner.is_empty() => vec![verb],
        inner => inner.into_iter().map(|name| format!("{verb} {name}")).collect(),
    };
    listed("--help").into_iter().flat_map(inner).collect()
}

#[test]
fn every_verb_that_writes_is_tried() {
    let verbs = verbs();
    assert!(verbs.len() > 15, "{verbs:?}");
    for verb in verbs {
        let help = Place::new().run(&format!("{verb} --help")).stdout;
        let writes = help.contains("--out") || help.contains("<DIR>");
        let tried = LINES.iter().any(|line| line.starts_with(&format!("{verb} ")));
        assert!(!writes || tried || NO_INPUT.contains(&verb.as_str()), "{verb} is in no line");
    }
}

/// Every file that a verb writes, as a link to every file that it reads.
#[cfg(unix)]
#[test]
fn no_verb_replaces_an_input() {
    let place = with_inputs();
    let inputs = files(place.0.path());
    for line in LINES {
        let ran = place.run(line);
        assert!(matches!(ran.code, Some(0 | 3)), "{line}: {ran:#?}");
        let written: Vec<PathBuf> =
            files(place.0.path()).into_keys().filter(|path| !inputs.contains_key(path)).collect();
        assert!(!written.is_empty(), "{line}");
        let read: Vec<&PathBuf> = inputs
            .keys()
            .filter(|path| {
                let name = path.strip_prefix(place.0.path()).unwrap().to_str().unwrap();
                line.split(' ').any(|word| word == name)
                    || (line.starts_with("fleet set") && name == "set/held.csv")
                    || (line.starts_with("fleet manifest") && name == "held.csv")
            })
            .collect();
        assert!(!read.is_empty() || !line.contains("model.json"), "{line}");
        let pairs = written.iter().flat_map(|o| read.iter().map(move |i| (o, *i)));
        for (k, (output, input)) in pairs.enumerate() {
            fs::remove_file(output).unwrap();
            match k % 2 {
                0 => fs::hard_link(input, output).unwrap(),
                _ => std::os::unix::fs::symlink(input, output).unwrap(),
            }
            let what = format!("{line}: {} as a link to {}", output.display(), input.display());
            let ran = place.run(line);
            assert!(matches!(ran.code, Some(1 | 2)), "{what}: {ran:#?}");
            assert!(
                ran.stderr.contains("the output would overwrite the input"),
                "{what}: {ran:#?}"
            );
            assert_eq!(fs::metadata(output).unwrap().len(), inputs[input].len() as u64, "{what}");
            for (path, bytes) in &inputs {
                assert!(fs::read(path).unwrap() == *bytes, "{what} changed {}", path.display());
            }
            fs::remove_file(output).unwrap();
            fs::write(output, "").unwrap();
        }
        written.iter().for_each(|path| fs::remove_file(path).unwrap());
    }
}

#[test]
fn the_same_file_under_another_path_is_refused_and_standard_output_is_not() {
    let place = with_inputs();
    let before = files(place.0.path());
    let absolute = place.path("motion.csv").display().to_string();
    for out in ["motion.csv", "./motion.csv", "set/../motion.csv", &absolute, "model.json"] {
        let ran = place.run(&format!("simulate model.json motion.csv --out {out}")).ends_with(2);
        ran.says(&["the output would overwrite the input", "hint: give the output another name"]);
    }
    // The folder of a result stands for the model in it.
    fs::create_dir(place.path("result")).unwrap();
    fs::rename(place.path("other.json"), place.path("result/model.json")).unwrap();
    place.run("identify recording.csv --prior result --out result").ends_with(2);
    fs::rename(place.path("result/model.json"), place.path("other.json")).unwrap();
    // A recording of a data set, which is no table of an earlier run.
    place
        .run("fleet set --out set/held.csv")
        .ends_with(1)
        .says(&["the output would overwrite the input"]);
    assert_eq!(files(place.0.path()), before);
    place.run("simulate model.json motion.csv --out -").ends_with(0);
    // The same command again replaces what it wrote.
    for line in ["fleet set --out set/fleet.csv", "simulate model.json motion.csv --out force.csv"]
    {
        let first = place.run(line).code;
        assert_eq!(place.run(line).code, first, "{line}");
    }
    #[cfg(unix)]
    {
        let motion = fs::File::open(place.path("motion.csv")).unwrap();
        let mut command = place.command("simulate model.json - --out motion.csv");
        Ran::from(command.stdin(motion).output().unwrap()).ends_with(2);
    }
}

#[cfg(unix)]
#[test]
fn no_verb_panics_for_an_argument_that_is_not_utf_8() {
    use std::ffi::OsString;
    use std::os::unix::ffi::{OsStrExt, OsStringExt};
    let odd = |word: &str| OsString::from_vec([b"\xff", word.as_bytes()].concat());
    let place = with_inputs();
    let names = place.names();
    let run = |words: &[OsString]| {
        let line = format!("{words:?}");
        let ran = Ran::from(place.command("").args(words).output().unwrap());
        assert_no_panic(&line, &ran);
        ran
    };
    for verb in verbs() {
        let words: Vec<OsString> = verb.split(' ').map(OsString::from).collect();
        for other in ["", "--out", "--name", "--columns", "--topic", "--report"] {
            let option = (!other.is_empty()).then(|| OsString::from(other));
            run(&[words.clone(), option.into_iter().collect(), vec![odd("x")]].concat());
        }
    }
    for name in names {
        if place.path(&name).is_file() {
            let copy = place.0.path().join(odd(&name));
            fs::copy(place.path(&name), copy).unwrap();
        }
    }
    for line in LINES {
        let is_input = |word: &str| place.path(word).is_file();
        let words: Vec<OsString> = line
            .split(' ')
            .map(|word| if is_input(word) { odd(word) } else { word.into() })
            .collect();
        let ran = run(&words);
        assert!(matches!(ran.code, Some(0 | 3)), "{line}: {ran:#?}");
        // The outputs, too.
        let outputs = words.windows(2).filter(|pair| pair[0].as_bytes().starts_with(b"--"));
        for output in outputs.map(|pair| pair[1].clone()) {
            let own = |word: &OsString| match *word == output {
                true => OsString::from_vec([word.as_bytes(), b"\xff"].concat()),
                false => word.clone(),
            };
            if !output.as_bytes().starts_with(b"\xff") {
                run(&words.iter().map(own).collect::<Vec<_>>());
            }
        }
    }
}

#[test]
fn the_command_line_of_a_report_is_whole_and_names_no_folder() {
    let place = with_inputs();
    let text = fs::read_to_string(place.path("recording.csv")).unwrap();
    let text = text.replacen("force_n", "a/b [N]", 1);
    fs::write(place.path("set/odd.csv"), text).unwrap();
    let folder = place.path("set").display().to_string();
    let mut command = place.command("identify --out result --columns");
    let columns = "time_s=time_s,position_m=position_m,force_n=a/b [N]";
    let ran = command.args([columns, &format!("{folder}/odd.csv")]).output().unwrap();
    Ran::from(ran);
    let report = fs::read_to_string(place.path("result/report.html")).unwrap();
    assert!(!report.contains(&folder));
    let expected =
        "trocar identify --columns 'time_s=time_s,position_m=position_m,force_n=a/b [N]' odd.csv";
    let plain = report.replace("&#39;", "'").replace("&#x27;", "'");
    assert!(
        plain.contains(expected),
        "{:?}",
        plain.split("trocar identify").nth(1).map(|t| &t[..200])
    );
}

/// `kill -9` runs no handler: what is left is removed by the next output into the same folder, and
/// what another process is still writing is not.
#[cfg(unix)]
#[test]
fn what_a_killed_run_leaves_is_removed_by_the_next() {
    use std::io::Write;
    use std::process::{Child, Stdio};
    let place = with_inputs();
    let before = place.names();
    let hidden = || -> Vec<String> {
        place.names().into_iter().filter(|name| name.starts_with(".trocar")).collect()
    };
    // With one more unfinished output than the `earlier` ones, or without those.
    let start = |line: &str, earlier: &[String]| -> Child {
        let child =
            place.command(line).stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        while !hidden().iter().any(|name| !earlier.contains(name)) {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        child
    };
    let kill = |mut child: Child| {
        child.kill().unwrap();
        child.wait().unwrap();
    };
    let folder = start("identify recording.csv --out result", &[]);
    let file = start("simulate model.json - --out force.csv", &hidden());
    kill(folder);
    kill(file);
    let abandoned = hidden();
    assert_eq!(abandoned.len(), 2, "{abandoned:?}");
    let mut living = start("simulate model.json - --out slow.csv", &abandoned);
    assert_eq!(hidden().len(), 1, "{:?}", hidden());
    place.run("man --out pages").ends_with(0);
    assert_eq!(hidden().len(), 1, "the file of a living process was removed");
    living.stdin.take().unwrap().write_all(&fs::read(place.path("motion.csv")).unwrap()).unwrap();
    assert!(living.wait().unwrap().success());
    let mut expected = [before, vec!["pages".to_owned(), "slow.csv".to_owned()]].concat();
    expected.sort();
    assert_eq!(place.names(), expected);
}
