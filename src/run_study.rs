//! The `study` command.

use std::path::PathBuf;
use std::process::ExitCode;

use vpm_vdb::study::{self, Options};

use crate::cli::StudyArgs;
use crate::run::{FAILED, load, print, with_terminal};

/// Runs or continues a study.
pub(crate) fn study(args: &StudyArgs) -> anyhow::Result<ExitCode> {
    let scene = load(&args.scene, None)?;
    let default = || PathBuf::from(format!("{}_study", scene.name));
    let options = Options {
        folder: args.output.clone().unwrap_or_else(default),
        scene_file: args.scene.clone(),
        quick: args.quick,
        reference: args.reference.clone(),
        budget: args.budget,
        resolution: args.resolution,
        anew: args.anew,
    };
    let outcome = with_terminal(args.quiet, args.threads, |exec| {
        Ok(study::run(&scene, &options, exec)?)
    })?;
    if !args.quiet {
        tell(&outcome, &options)?;
    }
    let nonfinite = outcome.study.nonfinite_pixels;
    if nonfinite > 0 {
        eprintln!("error: {nonfinite} pixels were NaN or infinite in some run");
    }
    let failed = outcome.interrupted || nonfinite > 0;
    Ok(ExitCode::from(if failed { FAILED } else { 0 }))
}

/// The answers in short.
fn tell(outcome: &study::Outcome, options: &Options) -> anyhow::Result<()> {
    let study = &outcome.study;
    for target in &study.targets {
        let line = match &target.choice {
            Some(c) => format!(
                "{:>4} %  {:8.2} s  vpm-vdb render {} {}{}",
                target.percent,
                c.seconds_own_resolution,
                options.scene_file.display(),
                c.options,
                if c.extrapolated {
                    "  (extrapolated)"
                } else {
                    ""
                }
            ),
            None => format!(
                "{:>4} %  no setting of this study reaches it",
                target.percent
            ),
        };
        print(&line)?;
    }
    let [done, planned] = outcome.runs;
    if done < planned {
        eprintln!(
            "{done} of {planned} runs are done; the same command with a larger --budget goes on"
        );
    }
    print(&format!("{}", options.folder.join("index.html").display()))
}
