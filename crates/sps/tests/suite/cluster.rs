//! The recipes in `cluster/`: under a Slurm that is started here, and with GNU parallel. What is not
//! installed is left out, with a printed line.

use std::fs;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Scratch, root};

/// Whatever is waited for is there by then, or never.
const LONG: Duration = Duration::from_secs(300);

#[test]
fn an_array_of_four_one_of_them_killed_comes_to_what_one_run_does() {
    let Some(slurm) = Slurm::start() else {
        return;
    };
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "epochs = 3", "epochs = 200");
    let expected = scratch.ran();
    let mut submit = slurm.command("cluster/slurm.sh");
    submit.env("SBATCH_OUTPUT", scratch.path("job-%j.log"));
    submit.args(scratch.words("@tiny.toml 4 --out @slurm"));
    let submitted = said(&mut submit);
    let merge = submitted.trim().rsplit(' ').next().unwrap();
    // One of those that train networks.
    let begun = scratch.path("slurm/shards/3-of-4/shard.json");
    wait("shard 3/4", || begun.exists());
    kill(&scratch.path("slurm"), "3/4");
    wait("the merge", || {
        let at_work = said(slurm.command("squeue").args(["-h", "-o", "%A"]));
        !at_work.lines().any(|job| job == merge)
    });
    let logs = logs(&scratch);
    let report = scratch.path("slurm/report.html");
    assert!(report.exists(), "{submitted}{logs}{}", slurm.logs());
    assert!(logs.contains("shard 3/4 was killed (status 137)"), "{logs}");
    assert_eq!(scratch.results_in("slurm"), expected);
}

#[test]
fn parallel_comes_to_what_one_run_does() {
    if !is_installed("parallel") {
        return;
    }
    let scratch = Scratch::new();
    said(command("cluster/parallel.sh").args(scratch.words("@tiny.toml 3 --out @parallel")));
    assert_eq!(scratch.results_in("parallel"), scratch.ran());
}

/// In the root of the repository, as the recipes are started.
fn command(program: &str) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root());
    command.env("XTASK", env!("CARGO_BIN_EXE_sps"));
    command
}

/// A controller and a node of their own, gone with the value.
struct Slurm {
    folder: Scratch,
    daemons: Vec<Child>,
}

impl Slurm {
    /// None where it is not installed, or may not be started.
    fn start() -> Option<Self> {
        let programs = ["munged", "slurmctld", "slurmd", "sbatch"];
        if !programs.iter().all(|name| is_installed(name)) {
            return None;
        }
        if said(Command::new("id").arg("-u")).trim() != "0" {
            println!("SKIPPED: slurmd runs as root alone");
            return None;
        }
        let mut slurm = Self {
            folder: Scratch::empty(),
            daemons: Vec::new(),
        };
        slurm.configure();
        let files = ["socket", "key-file", "pid-file", "seed-file", "log-file"];
        let files = files.map(|name| format!(" --{name}=@munge.{name}"));
        slurm.daemon(&format!("munged --foreground --force{}", files.concat()));
        wait("munge", || slurm.folder.path("munge.socket").exists());
        slurm.daemon("slurmctld -D");
        slurm.daemon("slurmd -D");
        wait("a node", || {
            let states = slurm.command("sinfo").args(["-h", "-o", "%T"]).output();
            String::from_utf8_lossy(&states.unwrap().stdout).contains("idle")
        });
        Some(slurm)
    }

    fn configure(&self) {
        let key: Vec<u8> = (0..=255).cycle().take(1024).collect();
        self.folder.write("munge.key-file", key);
        let mut own = Command::new("chmod");
        said(own.arg("400").arg(self.folder.path("munge.key-file")));
        let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
        let name = name.trim().split('.').next().unwrap();
        let [controller, node] = [free_port(), free_port()];
        let folder = self.folder.path("").display().to_string();
        let folder = folder.trim_end_matches('/');
        let config = format!(
            "ClusterName=test\n\
             SlurmctldHost={name}(127.0.0.1)\n\
             SlurmctldPort={controller}\n\
             SlurmdPort={node}\n\
             SlurmUser=root\n\
             SlurmdUser=root\n\
             AuthType=auth/munge\n\
             AuthInfo=socket={folder}/munge.socket\n\
             CredType=cred/munge\n\
             StateSaveLocation={folder}/state\n\
             SlurmdSpoolDir={folder}/spool\n\
             SlurmctldPidFile={folder}/slurmctld.pid\n\
             SlurmdPidFile={folder}/slurmd.pid\n\
             ProctrackType=proctrack/linuxproc\n\
             TaskPlugin=task/none\n\
             SelectType=select/cons_tres\n\
             SchedulerParameters=batch_sched_delay=0,sched_interval=1,bf_interval=1\n\
             SlurmdParameters=config_overrides\n\
             NodeName={name} NodeAddr=127.0.0.1 CPUs=4 RealMemory=1000\n\
             PartitionName=all Nodes={name} Default=YES State=UP\n"
        );
        self.folder.write("slurm.conf", config);
        for name in ["state", "spool"] {
            fs::create_dir(self.folder.path(name)).unwrap();
        }
    }

    /// A command that talks to this Slurm.
    fn command(&self, program: &str) -> Command {
        let mut command = command(program);
        command.env("SLURM_CONF", self.folder.path("slurm.conf"));
        command
    }

    fn daemon(&mut self, line: &str) {
        let words = self.folder.words(line);
        let log = self.folder.path(&format!("{}.out", words[0]));
        let log = fs::File::create(log).unwrap();
        let mut daemon = self.command(&words[0]);
        daemon.args(&words[1..]).stdout(Stdio::null());
        self.daemons.push(daemon.stderr(log).spawn().unwrap());
    }

    fn logs(&self) -> String {
        let logs = ["slurmctld", "slurmd"].map(|name| self.folder.read(&format!("{name}.out")));
        logs.join("\n")
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        for daemon in self.daemons.iter_mut().rev() {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}

fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

fn is_installed(program: &str) -> bool {
    let found = Command::new("which").arg(program).output();
    let found = found.is_ok_and(|output| output.status.success());
    if !found {
        println!("SKIPPED: {program} is not installed");
    }
    found
}

/// What a command that must succeed prints.
fn said(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {log}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn wait(what: &str, is_there: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is_there() {
        assert!(begun.elapsed() < LONG, "{what} is not there");
        std::thread::yield_now();
    }
}

/// Kills the process that does this shard of the run in a folder.
fn kill(run: &Path, shard: &str) {
    let run = run.display().to_string();
    let does_shard = |id: &String| {
        let line = fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).into_owned();
        let mut words = line.split('\0');
        words.next() == Some(env!("CARGO_BIN_EXE_sps"))
            && words.any(|word| word == run)
            && words.any(|word| word == shard)
    };
    let all = fs::read_dir("/proc").unwrap();
    let names = all.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
    let mut ids = names.filter(|name| name.parse::<u32>().is_ok());
    let id = ids.find(does_shard).expect("a shard at work");
    said(Command::new("kill").arg("-9").arg(id));
}

/// What the jobs have printed.
fn logs(scratch: &Scratch) -> String {
    let files = fs::read_dir(scratch.path(".")).unwrap();
    let logs = files.map(|entry| entry.unwrap().path());
    let logs = logs.filter(|path| path.extension().is_some_and(|ending| ending == "log"));
    logs.map(|path| fs::read_to_string(path).unwrap()).collect()
}
