// The page: files in, results out. Each file has its own result, which stays until it is removed.
"use strict";

const MOST = 64e6; // bytes of a file
let bench; // the robot shown, for logs

async function readFiles(files) {
  for (const file of files) await use(file.name, () => {
    if (file.size > MOST) throw new Error(`has ${fixed(file.size / 1e6, 0)} MB; at most ${MOST / 1e6} are read: cut the log's end off into a file of its own`);
    return file.text();
  });
}

// One text: a robot's JSON, a log of its readings, or a printer's.
async function use(name, read) {
  const said = find("said"), show = (...shown) => {
    const card = h("article", { ariaLabel: name }, h("h3", {}, name), button("Remove", () => card.remove()), ...shown);
    find("results").prepend(card);
  };
  said.textContent = `Reading ${name} …`;
  await new Promise((done) => setTimeout(done, 20)); // the line is shown before the work begins
  try {
    const begun = performance.now();
    show(...result(name, await read()));
    said.textContent = `${name}: answered in ${fixed((performance.now() - begun) / 1000, 1)} s.`;
  } catch (error) {
    const stopped = error instanceof RangeError || error instanceof WebAssembly.RuntimeError;
    const why = stopped ? "could not be calibrated: the computation stopped. Reload the page; is the file complete?" : error.message;
    said.textContent = "";
    show(h("p", { className: "bad" }, `${name}: ${why}`.replace(/[.]?$/, ".")));
    if (stopped) await begin(); // its memory may be inconsistent
  }
}

function result(name, text) {
  if (!text.trim()) throw new Error("is empty");
  if (text.includes("\0")) throw new Error("is not a text file");
  if (text.trimStart().startsWith("{")) return robotResult(text);
  const heads = /^(?!#).*\S.*$/m.exec(text)?.[0] ?? "";
  if (/^"?\w+"?([,;\t]"?\w+"?)+$/.test(heads.trim())) return bench.readLog(text);
  const answer = printerAnswer(text, ["arm", "probe-radius", "next"].map((id) => find(id).valueAsNumber || 0));
  if (answer.error) throw new Error(answer.error);
  return printerResult(answer, name);
}

function robotResult(text) {
  let of;
  try { of = JSON.parse(text); } catch { throw new Error("starts like JSON but is not; is it truncated?"); }
  showRobot(of);
  return [h("p", {}, `${of.title || of.name}: shown below. Drop a CSV log of ${of.readings.map((each) => each.name).join(", ")} (m, rad) to calibrate it.`)];
}

function showRobot(of) {
  bench = new Workbench(of, find("robot"));
  find("robot-title").textContent = `Try it: ${of.title || of.name}`;
}

async function begin() {
  await core.start(find("wasm").textContent);
  showRobot(JSON.parse(find("h4").textContent));
}

for (const kind of ["dragover", "dragleave", "drop"])
  document.addEventListener(kind, (event) => { event.preventDefault(); find("drop").classList.toggle("over", kind === "dragover"); });
document.addEventListener("drop", (event) => readFiles([...event.dataTransfer.files]));
find("file").onchange = async ({ target }) => {
  await readFiles([...target.files]);
  target.value = ""; // the same file again is a change, too
};
find("use-paste").onclick = () => use("pasted text", () => find("paste").value);

const page = window.truepose = { printerAnswer, ready: begin(), get bench() { return bench; } };
page.ready.catch((error) => { find("said").textContent = `This browser cannot run the page: ${error.message}.`; });
