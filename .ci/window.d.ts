// What early.js puts on the window for the other scripts of the training page.
interface Window {
  ravenjax: Record<string, any>;
}
