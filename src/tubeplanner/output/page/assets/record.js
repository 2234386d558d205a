// A video of one run, made by the browser itself.
const FORMATS = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];
const FRAMES_PER_SECOND = 60;
let recorder = null;

function whyNot() {  // why this browser records nothing; empty if it does
  if (!window.MediaRecorder) return "this browser has no MediaRecorder";
  if (!HTMLCanvasElement.prototype.captureStream) return "this browser captures no canvas";
  if (!FORMATS.some((each) => MediaRecorder.isTypeSupported(each)))
    return "this browser records neither WebM nor MP4";
  return "";
}

function save(blob) {
  const link = element("a"), kind = blob.type.includes("mp4") ? "mp4" : "webm";
  link.download = `${data.title.replace(/[^\w.-]+/g, "_")}.${kind}`;
  link.href = URL.createObjectURL(blob);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function record() {  // one run at the chosen rate, the scene alone and in the middle
  const stream = viewer.renderer.domElement.captureStream(FRAMES_PER_SECOND), chunks = [];
  recorder = new MediaRecorder(stream, {
    mimeType: FORMATS.find((each) => MediaRecorder.isTypeSupported(each)),
    videoBitsPerSecond: 8e6,
  });
  recorder.addEventListener("dataavailable", ({data: chunk}) => chunks.push(chunk));
  recorder.addEventListener("stop", () => {
    stream.getTracks().forEach((track) => track.stop());
    save(new Blob(chunks, {type: recorder.mimeType}));
    recorder = null;
    showRecording();
    if (!followed) lookAtAll(lookedFrom);
  });
  viewer.camera.clearViewOffset();
  recorder.start();
  setTime(0);
  setPlaying(true);
  showRecording();
}

function stopRecording() {
  if (recorder && recorder.state === "recording") recorder.stop();
  setPlaying(false);
}

function showRecording() {
  byId("record").classList.toggle("on", Boolean(recorder));
  byId("record").textContent = recorder ? `Recording ${inSeconds(time)}: stop` : "Record video";
}

function addRecording() {
  if (!(data.duration > 0)) return;
  const title = "one run at the chosen rate, saved as a video file";
  const made = button("Record video", title, () => recorder ? stopRecording() : record());
  const reason = whyNot();
  made.id = "record";
  made.disabled = Boolean(reason);
  if (reason) made.title = `no video: ${reason}`;
  byId("tools").append(made);
}
