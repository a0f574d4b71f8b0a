// Lets every figure be zoomed: by its buttons, by the wheel with Ctrl, by two fingers; dragged then.
for (const frame of document.querySelectorAll(".zoom")) {
  const image = frame.querySelector("img");
  const [nearer, farther, whole] = frame.parentElement.querySelectorAll("button");
  const zoom = Panzoom(image, {
    maxScale: 20, minScale: 1, contain: "outside", panOnlyWhenZoomed: true, cursor: "auto",
    touchAction: "pan-y",
  });
  frame.classList.add("able");
  nearer.addEventListener("click", () => zoom.zoomIn());
  farther.addEventListener("click", () => zoom.zoomOut());
  whole.addEventListener("click", () => zoom.reset());
  frame.addEventListener("wheel", (event) => { if (event.ctrlKey) zoom.zoomWithWheel(event); });
  image.addEventListener("panzoomchange", (event) => {
    const near = event.detail.scale > 1; // a finger scrolls the page until then
    image.style.touchAction = near ? "none" : "pan-y";
    image.style.cursor = near ? "move" : "auto";
  });
}
