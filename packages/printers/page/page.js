// The page: files in, results out. Each file has its own result, which stays until it is removed.
"use strict";

const MOST = 64e6; // bytes of a file
let bench; // the robot shown, for logs

async function readFiles(files) {
  for (const file of files) {
    if (file.size > MOST) say(file.name, `has ${fixed(file.size / 1e6, 0)} MB; at most ${MOST / 1e6} are read: cut the log's end off into a file of its own`);
    else await use(file.name, await file.text());
  }
}

// One text: a robot's JSON, a log of its readings, or a printer's.
async function use(name, text) {
  find("said").textContent = `Reading ${name} …`;
  await new Promise((done) => setTimeout(done, 20)); // the line is shown before the work begins
  try {
    const begun = performance.now();
    const shown = result(name, text);
    find("said").textContent = `${name}: answered in ${fixed((performance.now() - begun) / 1000, 1)} s.`;
    card(name, shown);
  } catch (error) {
    say(name, error instanceof RangeError || error instanceof WebAssembly.RuntimeError
      ? "could not be calibrated: the computation stopped. Reload the page; is the file complete?" : error.message);
    if (error instanceof WebAssembly.RuntimeError) await begin(); // its memory may be inconsistent
  }
}

function result(name, text) {
  if (!text.trim()) throw new Error("is empty");
  if (text.includes("\0")) throw new Error("is not a text file");
  if (text.trimStart().startsWith("{")) return robotResult(text);
  const heads = /^(?!#).*\S.*$/m.exec(text)?.[0] ?? "";
  if (/^"?\w+"?([,;\t]"?\w+"?)+$/.test(heads.trim())) return [bench.readLog(text)];
  const value = (id) => find(id).valueAsNumber || 0;
  const answer = printerAnswer(text, [value("arm"), value("probe-radius"), value("next")]);
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

function card(name, shown) {
  const made = h("article", { ariaLabel: name }, h("div", { className: "row" }, h("h3", {}, name),
    h("button", { type: "button", onclick: () => made.remove() }, "Remove")), shown);
  find("results").prepend(made);
}
function say(name, why) {
  find("said").textContent = "";
  card(name, [h("p", { className: "bad" }, `${name}: ${why}`.replace(/[.]?$/, "."))]);
}

async function begin() {
  await core.start(find("wasm").textContent);
  showRobot(JSON.parse(find("h4").textContent));
}

const drop = find("drop");
for (const [kind, over] of [["dragover", true], ["dragleave", false], ["drop", false]])
  document.addEventListener(kind, (event) => { event.preventDefault(); drop.classList.toggle("over", over); });
document.addEventListener("drop", (event) => readFiles([...event.dataTransfer.files]));
find("file").addEventListener("change", async (event) => {
  await readFiles([...event.target.files]);
  event.target.value = ""; // the same file again is a change, too
});
find("use-paste").addEventListener("click", () => use("pasted text", find("paste").value));

const page = window.truepose = { core, Robot, printerAnswer, logOf, ready: begin(), get bench() { return bench; } };
page.ready.catch((error) => { find("said").textContent = `This browser cannot run the page: ${error.message}.`; });
