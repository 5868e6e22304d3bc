//! A shell stands in for ffmpeg: what it writes is under our control, and it is everywhere.

use super::*;

const PATH: &str = "clip.mkv";
const HEAD: &str = "printf 'YUV4MPEG2 W3 H2 F25:1 Ip A0:0 Cmono XCOLORRANGE=FULL\\n';";

fn shell(script: &str) -> Result<Video, ImagesError> {
    let mut command = Command::new("/bin/sh");
    command.args(["-c", script]);
    Video::start(Path::new(PATH), command, Limits::default())
}

/// The error of a whole reading: one line that names the file.
fn complaint(script: &str) -> String {
    let read = shell(script).and_then(|mut video| {
        let mut pixels = vec![0; (video.width() * video.height()) as usize];
        while video.read_into(&mut pixels)? {}
        Ok(())
    });
    let text = read.unwrap_err().to_string();
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.starts_with("clip.mkv: "), "{text}");
    text
}

#[test]
fn frames_come_one_by_one_until_the_end() {
    let mut video = shell(&format!("{HEAD} printf 'FRAME\\nabcdefFRAME Ip\\nghijkl'")).unwrap();
    assert_eq!((video.width(), video.height()), (3, 2));
    let mut pixels = [0; 6];
    assert!(video.read_into(&mut pixels).unwrap());
    assert_eq!(&pixels, b"abcdef");
    assert!(video.read_into(&mut pixels).unwrap());
    assert!(!video.read_into(&mut pixels).unwrap());
    assert_eq!(&pixels, b"ghijkl");
    assert_eq!(video.complaint(), None);
}

#[test]
fn a_failure_is_told_in_the_last_line_that_is_said() {
    assert_eq!(
        complaint("echo first >&2; echo 'file:clip.mkv: Invalid data found' >&2; echo >&2; exit 1"),
        "clip.mkv: ffmpeg cannot decode it: Invalid data found"
    );
    assert!(complaint("exit 7").ends_with("exit status: 7"));
    assert!(complaint(&format!("{HEAD} printf 'FRAME\\nabc'; echo disk >&2; exit 1")).ends_with("it: disk"));
    assert!(complaint("exit 0").ends_with("it gives no frame"));
}

#[test]
fn a_stream_that_ends_within_a_frame_or_is_none_is_refused() {
    let within = |script: &str| complaint(&format!("{HEAD} {script}"));
    assert!(within("printf 'FRAME\\nabc'").ends_with("its stream ends within frame 0"));
    assert!(within("printf 'FRAME\\nabcdefFRA'").ends_with("its stream ends within frame 1"));
    assert!(within("printf 'PICTURE\\nabcdef'").ends_with("no YUV4MPEG2"));
    assert!(complaint("head -c 5000 /dev/zero").ends_with("no YUV4MPEG2"));
    assert!(complaint("echo 'YUV4MPEG2 W3 H2 C420jpeg'").ends_with("no YUV4MPEG2"));
    assert!(complaint("echo 'YUV4MPEG2 W-3 H2 Cmono'").ends_with("no YUV4MPEG2"));
    assert!(
        complaint("echo 'YUV4MPEG2 W5000 H2 Cmono'")
            .ends_with("is 5000x2 pixels, each side must be 1 to 4096 pixels")
    );
}

#[test]
fn what_was_complained_of_on_the_way_is_kept() {
    let mut video = shell(&format!("{HEAD} printf 'FRAME\\nabcdef'; echo 'ended prematurely' >&2")).unwrap();
    while video.read_into(&mut [0; 6]).unwrap() {}
    assert_eq!(video.complaint(), Some("ended prematurely"));
}

#[test]
fn complaints_that_fill_a_pipe_hold_nothing_up() {
    let flood = "yes 'corrupt macroblock' | head -n 100000 >&2;";
    let mut video = shell(&format!("{HEAD} {flood} printf 'FRAME\\nabcdef'; {flood}")).unwrap();
    assert!(video.read_into(&mut [0; 6]).unwrap());
    assert!(!video.read_into(&mut [0; 6]).unwrap());
}

#[test]
fn the_process_is_ended_and_waited_for_when_nobody_reads_on() {
    let video = shell(&format!("{HEAD} exec sleep 1000")).unwrap();
    let process = PathBuf::from(format!("/proc/{}", video.process.id()));
    assert!(process.exists());
    drop(video);
    assert!(!process.exists(), "no zombie either");
}

#[test]
fn without_the_program_the_message_says_what_to_do() {
    let missing = Command::new("/no/such/ffmpeg");
    let error = Video::start(Path::new(PATH), missing, Limits::default()).unwrap_err().to_string();
    assert!(error.contains("install the package ffmpeg"), "{error}");
    assert!(error.contains("`ffmpeg -i clip.mkv FOLDER/%06d.png`"), "{error}");
}
