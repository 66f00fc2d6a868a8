for (const figure of document.querySelectorAll(".pictures figure")) {
  const slide = figure.querySelector(".slide"), range = figure.querySelector("input");
  const set = (v) => { range.value = v; slide.style.setProperty("--edge", v + "%"); };
  range.addEventListener("input", () => set(range.value));
  figure.querySelector(".toggle").addEventListener("click", () => set(+range.value < 50 ? 100 : 0));
}
for (const button of document.querySelectorAll(".copy")) {
  button.addEventListener("click", async () => {
    const code = button.parentNode.querySelector("code");
    try {
      await navigator.clipboard.writeText(code.textContent);
      button.textContent = "copied";
    } catch {
      getSelection().selectAllChildren(code);
      button.textContent = "marked";
    }
  });
}
